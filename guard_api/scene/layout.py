"""Layouts: free places for the robot and the objects of N worlds, by rejection.

Every world draws from its own stream, so its layout depends on nothing but its seed. Source: GUARD's engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import SpecError

Array = NDArray[np.float64]

_TRIES: Final = 100
"""Candidates per item before the whole layout is thrown away."""

_LAYOUTS: Final = 1000
"""Layouts thrown away before the request counts as impossible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """Something to place: `keepout` is the radius kept free around it [m]."""

    name: str
    keepout: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutSampler:
    """Places `items` in order, uniformly in `extents` (xmin, ymin, xmax, ymax) [m] shrunk by each item's keepout.

    Two items are never nearer than the sum of their keepouts.
    """

    items: tuple[Item, ...]
    extents: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        width = min(self.extents[2] - self.extents[0], self.extents[3] - self.extents[1])
        for item in self.items:
            if 2 * item.keepout > width:
                raise SpecError(
                    f"layout: {item.name} keeps {item.keepout} m free on every side, but the placement area "
                    f"{self.extents} is only {width} m wide: enlarge extents or lower keepout"
                )

    def sample(self, streams: Sequence[np.random.Generator]) -> Array:
        """Return the places of all items in one world per stream: (len(streams), items, 2) [m].

        Raises SpecError when a world finds no layout, with the numbers that make it impossible.
        """
        places = np.empty((len(streams), len(self.items), 2))
        pending = np.arange(len(streams))
        for _ in range(_LAYOUTS):
            drawn = np.stack([streams[i].random((len(self.items), _TRIES, 2)) for i in pending.tolist()])
            found, done = self._place(drawn)
            places[pending[done]] = found[done]
            pending = pending[~done]
            if len(pending) == 0:
                return places
        crowd = ", ".join(f"{item.name} {item.keepout}" for item in self.items)
        raise SpecError(
            f"layout: no free places found in {_LAYOUTS} layouts for {len(self.items)} items in {self.extents} with "
            f"keepouts [m] {crowd}: use fewer objects, smaller keepouts or larger extents"
        )

    def replace(
        self, index: int, places: Array, streams: Sequence[np.random.Generator]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Draw new places for item `index` among the others' `places` (n, items, 2).

        Returns the places (n, 2) and which worlds found one (n,); a world without one keeps its old place there.
        """
        others = np.delete(places, index, axis=1)
        reach = self._keepouts[index] + np.delete(self._keepouts, index)
        result = places[:, index].copy()
        pending = np.arange(len(places))
        for _ in range(_TRIES):
            drawn = np.stack([streams[i].random((_TRIES, 2)) for i in pending.tolist()])
            candidates = self._scale(drawn, self._keepouts[index])
            choice, done = _first_free(candidates, others[pending], reach)
            result[pending[done]] = choice[done]
            pending = pending[~done]
            if len(pending) == 0:
                break
        found = np.ones(len(places), dtype=bool)
        found[pending] = False
        return result, found

    @property
    def _keepouts(self) -> Array:
        return np.array([item.keepout for item in self.items])

    def _scale(self, unit: Array, keepout: float) -> Array:
        """Map numbers in [0, 1) `(..., 2)` into the extents shrunk by `keepout`."""
        low = np.array(self.extents[:2]) + keepout
        high = np.array(self.extents[2:]) - keepout
        return low + unit * (high - low)

    def _place(self, drawn: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Place all items from numbers `drawn` (n, items, tries, 2): places (n, items, 2), success (n,)."""
        keepouts = self._keepouts
        places = np.empty((len(drawn), len(self.items), 2))
        done = np.ones(len(drawn), dtype=bool)
        for i, keepout in enumerate(keepouts):
            candidates = self._scale(drawn[:, i], keepout)
            places[:, i], free = _first_free(candidates, places[:, :i], keepout + keepouts[:i])
            done &= free
            if not done.any():  # a crowded layout is thrown away as soon as one item finds no place
                break
        return places, done


def _first_free(candidates: Array, placed: Array, reach: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the first of `candidates` (n, tries, 2) that is at least `reach` (j,) away from all `placed` (n, j, 2).

    Returns the choices (n, 2) and whether there was one (n,); where there was none the choice is the first candidate.
    """
    free = np.ones(candidates.shape[:2], dtype=bool)
    for j, distance in enumerate(reach):
        gap = candidates - placed[:, None, j]
        free &= gap[..., 0] ** 2 + gap[..., 1] ** 2 >= distance**2
    first = free.argmax(axis=1)
    rows = np.arange(len(candidates))
    return candidates[rows, first], free[rows, first]
