"""Compass: the direction of a target in robot axes. Source: GUARD's engine."""

from __future__ import annotations

import numpy as np

from guard_api.physics.transition import Array, Snapshot


def compass(snapshot: Snapshot, target: Array, axes: int) -> Array:
    """Return the direction of `target` (N, 3) [m] in the root link's axes: (N, axes).

    The vector is cut to its first `axes` (2 or 3) components and divided by its norm + 0.001 m, so it fades near the
    target instead of jumping. With 2 axes the target's height counts as 0, as in GUARD.
    """
    offset = target - snapshot.position
    if axes == 2:
        offset[:, 2] = -snapshot.position[:, 2]
    direction = snapshot.in_robot_frame(offset[:, None])[:, 0, :axes]
    squares = direction * direction
    norm = np.sqrt(squares[:, 0] + squares[:, 1] + (squares[:, 2] if axes == 3 else 0.0))
    return direction / (norm + 0.001)[:, None]
