"""Driven bodies: constant-velocity motion to a target over the substeps of one step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.scene.spec import SceneSpec
from guard_sapien.compile import Copy
from guard_sapien.engine import physx, pose

Array = NDArray[np.float64]


class Drives:
    """Where the bodies of all worlds stand, and where `World.drive` sends the driven ones next.

    position (N, B, 3), quaternion (N, B, 4): of static and driven bodies; targets likewise; `pending` (B,) says which
    have one.
    """

    def __init__(self, spec: SceneSpec, num_worlds: int) -> None:
        shape = (num_worlds, spec.num_bodies)
        self.position, self.quaternion = np.zeros((*shape, 3)), np.zeros((*shape, 4))
        self.target_position, self.target_quaternion = np.zeros((*shape, 3)), np.zeros((*shape, 4))
        self.pending = np.zeros(shape, bool)

    def place(self, world: int, position: Array, quaternion: Array) -> None:
        """Note where the bodies (B, 3), (B, 4) of a world were put; its targets are dropped."""
        self.position[world], self.quaternion[world], self.pending[world] = position, quaternion, False

    def aim(self, bodies: slice, position: Array, quaternion: Array) -> None:
        """Set the targets of a group of bodies in all worlds."""
        self.target_position[:, bodies], self.target_quaternion[:, bodies] = position, quaternion
        self.pending[:, bodies] = True

    def waypoints(self, worlds: list[int], substeps: int) -> list[tuple[int, int, Array, Array]]:
        """Return (world, body, positions (substeps, 3), quaternions (substeps, 4)) for every pending drive."""
        found = [(w, int(b)) for w in worlds for b in np.flatnonzero(self.pending[w])]
        return [(w, b, *self._way(w, b, substeps)) for w, b in found]

    def arrive(self, worlds: list[int]) -> None:
        """Note that the driven bodies of `worlds` have reached their targets."""
        for world in worlds:
            there = self.pending[world]
            self.position[world, there] = self.target_position[world, there]
            self.quaternion[world, there] = self.target_quaternion[world, there]
            self.pending[world] = False

    def arrays(self) -> list[np.ndarray]:
        """Return every array, in a fixed order."""
        return [self.position, self.quaternion, self.target_position, self.target_quaternion, self.pending]

    def _way(self, world: int, body: int, substeps: int) -> tuple[Array, Array]:
        fraction = np.arange(1, substeps + 1) / substeps
        start, end = self.position[world, body], self.target_position[world, body]
        first, last = self.quaternion[world, body], self.target_quaternion[world, body]
        turn = rotations.multiply(last, rotations.conjugate(first))
        turn = turn if turn[0] >= 0 else -turn  # the short way round
        sine = float(np.linalg.norm(turn[1:]))
        axis = turn[1:] / sine if sine > 0 else np.array([0.0, 0.0, 1.0])
        steps = rotations.from_axis_angle(axis, fraction * 2.0 * np.arctan2(sine, turn[0]))
        return start + fraction[:, None] * (end - start), rotations.multiply(steps, first)


def send(copies: list[Copy], way: list[tuple[int, int, Array, Array]], substep: int) -> None:
    """Set the kinematic targets of one substep; PhysX derives the velocity that pushes others."""
    for world, body, positions, quaternions in way:
        component = copies[world].bodies[body]
        assert isinstance(component, physx.PhysxRigidDynamicComponent)
        component.set_kinematic_target(pose(positions[substep], quaternions[substep]))
