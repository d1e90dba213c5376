"""How objects move by themselves: directions, from which tasks and constraints compose their laws.

Source: GUARD (Zhao et al. 2023), eq. 8-10, with the unit directions of its engine instead of the paper's full distance
vectors: speeds do not grow with distance.
"""

from __future__ import annotations

import numpy as np

from guard_api.physics.transition import Array

_TINY = 1e-9
"""Distance [m] below which a direction is none."""


def away_from_neighbours(position: Array, distance: float) -> Array:
    """Return, for each of `position` (N, K, 3), the sum of unit vectors away from the others nearer than `distance`."""
    # By axis: (N, K, K) arrays are summed several times faster than the last axis of (N, K, K, 3) ones.
    x, y, z = (position[:, :, None, axis] - position[:, None, :, axis] for axis in range(3))
    length = np.sqrt(x * x + y * y + z * z)
    near = (length < distance) & (length > _TINY)
    if not near.any():
        return np.zeros_like(position)
    share = near / np.maximum(length, _TINY)
    return np.stack([(offset * share).sum(axis=2) for offset in (x, y, z)], axis=-1)


def _norm(vectors: Array) -> Array:
    """Return the lengths of `vectors` (..., 3)."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.sqrt(x * x + y * y + z * z)


def towards(position: Array, target: Array, *, spatial: bool) -> tuple[Array, Array]:
    """Return unit vectors (N, K, 3) from `position` (N, K, 3) to `target` (N, 1 or K, 3) and the distances (N, K) [m].

    In the plane, where heights count as 0, unless `spatial`.
    """
    offset = target - position
    if not spatial:
        offset[..., 2] = 0.0
    length = _norm(offset)
    return offset / np.maximum(length, _TINY)[..., None], length


def advanced(position: Array, velocity: Array, duration: float, heights: tuple[float, float] | None) -> Array:
    """Return `position` (N, K, 3) moved at `velocity` (N, K, 3) [m/s] for `duration` [s], kept within `heights` [m].

    Without heights the objects keep theirs.
    """
    moved = position + duration * velocity
    moved[..., 2] = position[..., 2] if heights is None else np.clip(moved[..., 2], *heights)
    return moved
