"""How deep the robot is inside round zones: the cost of everything that may be walked through."""

from __future__ import annotations

import numpy as np

from guard_api.physics.transition import Array, Snapshot, planar_distance


def depth(now: Snapshot, centres: Array, size: float, *, spatial: bool) -> Array:
    """Return max(0, size - d) for zones of radius `size` [m] at `centres` (N, K, 3): (N, K) [m].

    d is the distance in the plane from the robot's reference to the centre, or with `spatial` the distance in space
    from the robot (`Snapshot.distance`), so that a thick robot may be deeper than `size`. Source: GUARD's engine.
    """
    if spatial:
        return np.maximum(size - now.distance(centres), 0.0)
    return np.maximum(size - planar_distance(now.position, centres), 0.0)
