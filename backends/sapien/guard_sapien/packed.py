"""PhysX's packed state of one scene, as columns of one float array per world."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from guard_api.scene.spec import SceneSpec
from guard_sapien.compile import Copy
from guard_sapien.engine import physx

Array = NDArray[np.float64]

RIGID = 13
"""Numbers per rigid body and articulation root: quaternion, position, linear and angular velocity (of the com)."""


class PackedLayout:
    """Where the quantities of a scene lie in `PhysxCpuSystem.pack()`: bodies that can move, then the articulation.

    moving: (M,) the scene's numbers of the dynamic and driven bodies, in PhysX's order.
    """

    def __init__(self, spec: SceneSpec) -> None:
        self.moving = [i for i, body in enumerate(spec.bodies) if body.physics != "static"]
        self._dynamic = [k for k, i in enumerate(self.moving) if spec.bodies[i].physics == "dynamic"]
        self.num_joints = len(spec.robot.joints) if spec.robot else 0
        self._root = RIGID * len(self.moving)
        self._joints = self._root + RIGID
        self.width = self._joints + 4 * self.num_joints if spec.robot else self._root

    def read(self, copies: Sequence[Copy]) -> Array:
        """Return the packed state of all worlds: (N, width)."""
        packed = b"".join([system.pack() for system, _ in self.systems(copies)])
        return np.frombuffer(packed, np.float32).reshape(len(copies), self.width).astype(float)

    @staticmethod
    def systems(copies: Sequence[Copy]) -> list[tuple[physx.PhysxCpuSystem, int]]:
        """Return the physics systems of `copies` in order, each once, and how many of the worlds it holds."""
        return [(system, len(list(worlds))) for system, worlds in groupby(copy.system for copy in copies)]

    def bodies(self, packed: Array) -> Array:
        """Return the rigid rows of the moving bodies: (N, M, 13)."""
        return packed[:, : self._root].reshape(len(packed), len(self.moving), RIGID)

    def speeds(self, packed: Array) -> Array:
        """Return the velocities of the dynamic bodies, the root and the joints: (N, ...)."""
        rows = self.bodies(packed)[:, self._dynamic, 7:].reshape(len(packed), -1)
        return np.concatenate([rows, self.root(packed)[:, 7:], self.joints(packed)[1]], axis=1)

    def root(self, packed: Array) -> Array:
        """Return the rigid row of the articulation's first link: (N, 13)."""
        return packed[:, self._root : self._joints]

    def joints(self, packed: Array) -> tuple[Array, Array]:
        """Return joint positions and velocities (N, J) in PhysX's order."""
        first, count = self._joints, self.num_joints
        return packed[:, first : first + count], packed[:, first + count : first + 2 * count]
