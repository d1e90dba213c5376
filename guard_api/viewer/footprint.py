"""Where on the floor the things of a picture can be felt, so that no light is worked out elsewhere."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.floating]

CELLS: Final = 256
"""Cells along each side of the map."""


class Footprint:
    """The floor within `reach` [m] of any part's plan, on a grid. Most of a picture is floor far from everything.

    plan: (V, 2) [m] corners of the parts seen from above; starts: (K,) the first corner of each part.
    """

    def __init__(self, plan: Float, starts: NDArray[np.intp], reach: float) -> None:
        self._felt = np.zeros((CELLS + 2, CELLS + 2), bool)  # the outermost cells stand for all beyond, never felt
        self._origin, self._per_metre = np.zeros(2, np.float32), np.zeros(2, np.float32)
        if not len(starts):
            return
        # A part is convex, so it lies above the rectangle around its corners.
        lower = np.minimum.reduceat(plan, starts) - np.float32(reach)
        upper = np.maximum.reduceat(plan, starts) + np.float32(reach)
        self._origin = lower.min(axis=0)
        self._per_metre = np.float32(CELLS) / (upper.max(axis=0) - self._origin)
        for first, last in zip(self._cells(lower), self._cells(upper), strict=True):
            self._felt[first[0] : last[0] + 1, first[1] : last[1] + 1] = True
        self._felt[[0, -1]] = self._felt[:, [0, -1]] = False

    def covers(self, point: Float) -> NDArray[np.bool_]:
        """Return which of the floor points (P, 2) [m] may feel something."""
        column, row = self._cells(point).T
        return self._felt[column, row]

    def _cells(self, point: Float) -> NDArray[np.int32]:
        """Return the column and row (P, 2) of points (P, 2) [m]; those beyond the map are in its outermost cells."""
        return np.clip(np.floor((point - self._origin) * self._per_metre) + 1, 0, CELLS + 1).astype(np.int32)
