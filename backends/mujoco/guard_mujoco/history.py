"""The engine's rings of past sensor values, read for all worlds at once.

Every sensor of a scene keeps as many samples as an environment step has substeps, and takes one in every substep; so
one cursor serves them all. Source: MuJoCo's `mjData.history`, per sensor: user value, cursor to the newest sample,
times (n), values (n, dim).
"""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from guard_mujoco import kernels

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_CURSOR, _TIMES = 1, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """S numbers in the rings: sample k of number s is at first[s] + k stride[s]."""

    first: Indices
    stride: Indices

    def __len__(self) -> int:
        """Return S."""
        return len(self.first)

    def part(self, numbers: Indices) -> Columns:
        """Return the columns of some of the numbers."""
        return Columns(first=self.first[numbers], stride=self.stride[numbers])

    @staticmethod
    def joined(parts: Iterable[Columns]) -> Columns:
        """Return the columns of all numbers of `parts`, in order."""
        parts = list(parts)
        empty = np.empty(0, np.intp)
        return Columns(
            first=np.concatenate([empty, *(part.first for part in parts)]),
            stride=np.concatenate([empty, *(part.stride for part in parts)]),
        )


def columns_of(model: mujoco.MjModel, sensors: Sequence[int]) -> Columns:
    """Return the columns of all numbers of the sensors with these ids, in order."""
    parts = []
    for sensor in sensors:
        size, samples = int(model.sensor_dim[sensor]), int(model.sensor_history[sensor, 0])
        first = int(model.sensor_historyadr[sensor]) + _TIMES + samples
        parts.append(Columns(first=first + np.arange(size), stride=np.full(size, size)))
    return Columns.joined(parts)


class Window:
    """The last `substeps` samples of rings of `samples`, oldest first, in rows `history` (n, H) of worlds."""

    def __init__(self, history: Array, substeps: int, samples: int) -> None:
        self._history, self._substeps, self._samples = history, substeps, samples

    def read(self, columns: Columns) -> Array:
        """Return the values (n, substeps, S)."""
        newest = self._history[:, _CURSOR].astype(np.intp)
        slots = (newest[:, None] + np.arange(1 - self._substeps, 1)) % self._samples
        at = columns.first + slots[:, :, None] * columns.stride
        return self._history[np.arange(len(at))[:, None, None], at]

    def sum(self, columns: Columns) -> Array:
        """Return the sums over the samples (n, S), added in order of time whatever the number of worlds."""
        add = kernels.ring_sums()
        if add is None:
            return sum_in_order(self.read(columns))
        total = np.empty((len(self._history), len(columns)))
        add(self._history, _CURSOR, self._substeps, self._samples, columns.first, columns.stride, total)
        return total


def sum_in_order(values: Array) -> Array:
    """Return the sum of `values` (n, k, ...) over k, first to last; numpy picks its order by the layout, so by n."""
    total = values[:, 0].copy()
    for sample in range(1, values.shape[1]):
        total += values[:, sample]
    return total
