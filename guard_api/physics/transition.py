"""What tasks, constraints and sensors see: two instants of N worlds and the action between them.

Everything that scores or observes is a pure function of a `Transition`; that is why it cannot differ between engines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.state import State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """One instant of N worlds.

    state: the physical state, in the conventions of `guard_api.conventions`.
    position (N, 3) [m], linear_velocity (N, 3) [m/s], angular_velocity (N, 3) [rad/s]: of the robot's root link frame,
    world axes. rotation: (N, 3, 3) of the root link; its columns are the link's axes in the world.
    bodies: group name -> positions (N, count, 3) [m] of every group, phantoms included.
    """

    state: State
    position: Array
    rotation: Array
    linear_velocity: Array
    angular_velocity: Array
    bodies: Mapping[str, Array]

    def in_robot_frame(self, vectors: Array) -> Array:
        """Return world vectors `(N, K, 3)` in the axes of the root link: `(N, K, 3)`."""
        return in_frame(self.rotation, vectors)


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """One environment step: from `previous` to `now` under `action` (N, A), taking `duration` [s].

    Right after a reset `previous` is `now` and the action is zero.
    """

    previous: Snapshot
    now: Snapshot
    action: Array
    duration: float


def in_frame(rotation: Array, vectors: Array) -> Array:
    """Return world vectors `(N, K, 3)` in the axes of frames with `rotation` `(N, 3, 3)`: `(N, K, 3)`."""
    # A stacked product is one small product per world, so a world's bits do not depend on N.
    return vectors @ rotation


def rotation_matrices(quaternion: Array) -> Array:
    """Return the rotation matrices `(N, 3, 3)` of unit quaternions `(N, 4)`; a lean form for the hot path."""
    s = 2.0 * quaternion[:, :, None] * quaternion[:, None, :]
    R = np.empty((len(quaternion), 3, 3))
    R[:, 0, 0] = 1.0 - s[:, 2, 2] - s[:, 3, 3]
    R[:, 1, 1] = 1.0 - s[:, 1, 1] - s[:, 3, 3]
    R[:, 2, 2] = 1.0 - s[:, 1, 1] - s[:, 2, 2]
    R[:, 0, 1] = s[:, 1, 2] - s[:, 0, 3]
    R[:, 1, 0] = s[:, 1, 2] + s[:, 0, 3]
    R[:, 0, 2] = s[:, 1, 3] + s[:, 0, 2]
    R[:, 2, 0] = s[:, 1, 3] - s[:, 0, 2]
    R[:, 1, 2] = s[:, 2, 3] - s[:, 0, 1]
    R[:, 2, 1] = s[:, 2, 3] + s[:, 0, 1]
    return R
