"""Which of several candidates for a place overlaps least with what is there: where a reset spends its time."""

from __future__ import annotations

from typing import Any

import numpy as np

from guard_api.kernels import kernel
from guard_api.scene.area import Array, Mask


def freest(points: Array, allowed: Mask | None, places: Array, squared_reach: Array) -> tuple[Array, Array]:
    """Return the first of `points` (n, k, 3) that overlaps least with the items at `places` (n, items, 3) [m].

    Overlap is the sum of reach^2 - distance^2 in the plane over the items nearer than their `squared_reach` (items,)
    [m^2]. allowed: (n, k) which points count; None for all.
    Returns the points (n, 3), and their overlap (n,) [m^2], infinite where nothing is allowed.
    """
    fast = _freest()
    if fast is None:
        return _plainly_freest(points, allowed, places, squared_reach)
    if allowed is None:
        allowed = np.ones(points.shape[:2], dtype=bool)
    best, least = np.empty((len(points), 3)), np.empty(len(points))
    fast(points, allowed, places, squared_reach, best, least)
    return best, least


def _plainly_freest(points: Array, allowed: Mask | None, places: Array, squared_reach: Array) -> tuple[Array, Array]:
    # In place on contiguous arrays: copies would take longer than the arithmetic.
    dx = np.ascontiguousarray(points[..., 0])[:, None] - places[:, :, 0, None]
    dy = np.ascontiguousarray(points[..., 1])[:, None] - places[:, :, 1, None]
    dx *= dx
    dy *= dy
    dx += dy
    np.subtract(squared_reach[:, None], dx, out=dx)
    overlap = np.maximum(dx, 0.0, out=dx).sum(axis=1)
    if allowed is not None:
        overlap[~allowed] = np.inf
    chosen, rows = overlap.argmin(axis=1), np.arange(len(points))
    return points[rows, chosen], overlap[rows, chosen]


@kernel("float64[:,:,:], boolean[:,:], float64[:,:,:], float64[::1], float64[:,::1], float64[::1]")
def _freest(points: Any, allowed: Any, places: Any, squared_reach: Any, best: Any, least: Any) -> None:
    """Write what `freest` returns; no candidate is looked at longer than it takes to lose."""
    for world in range(points.shape[0]):
        chosen, lowest = 0, np.inf
        for k in range(points.shape[1]):
            if not allowed[world, k]:
                continue
            overlap = 0.0
            for i in range(places.shape[1]):
                dx = points[world, k, 0] - places[world, i, 0]
                dy = points[world, k, 1] - places[world, i, 1]
                overlap += max(squared_reach[i] - (dx * dx + dy * dy), 0.0)
                if overlap >= lowest:
                    break
            if overlap < lowest:
                chosen, lowest = k, overlap
            if lowest == 0.0:
                break
        for axis in range(3):
            best[world, axis] = points[world, chosen, axis]
        least[world] = lowest
