"""The engine's own equations of motion, M a + bias = effort, free of the traps in how it hands them out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.scene.spec import SceneSpec
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet
from guard_bullet.motion import RobotMotion

Array = NDArray[np.float64]

_NOWHERE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


class EngineDynamics:
    """Mass matrices (N, D, D) and bias forces (N, D) of a robot; D = J, or 6 + J with a floating base.

    The base's coordinates are the engine's: angular, then linear velocity of its centre of mass, principal axes.
    """

    def __init__(self, scene: SceneSpec, robot: RobotModel) -> None:
        self.num_coordinates = len(robot.joints) + (6 if robot.floating else 0)
        self._floating = robot.floating
        self._gravity = np.array(scene.gravity)
        # Mass matrices come angular first, bias forces linear first.
        self._order = np.r_[3:6, 0:3, 6 : self.num_coordinates]

    def __call__(self, instances: list[Instance], motion: RobotMotion) -> tuple[Array, Array]:
        """Return M and bias at the present motion; `instances` are the N engine instances."""
        _, quaternion, linear, angular = motion.engine_base()
        gravity = rotations.unrotate(quaternion, self._gravity)
        matrix, bias = [], []
        for instance, joints in zip(instances, motion.q.tolist(), strict=True):
            matrix.append(pybullet.calculateMassMatrix(instance.robot, joints, physicsClientId=instance.client))
        if not self._floating:
            for instance, joints, speeds, pull in zip(
                instances, motion.q.tolist(), motion.qd.tolist(), gravity, strict=True
            ):
                bias.append(self._welded_bias(instance, joints, speeds, pull))
            return np.array(matrix), np.array(bias)
        # The engine takes the base's turn as Euler angles, at a loss of seven digits. It matters for gravity only: the
        # base is given untilted, and gravity's proper direction as an acceleration of the base.
        turn = rotations.unrotate(quaternion, angular)
        speeds = np.concatenate([turn, rotations.unrotate(quaternion, linear), motion.qd], axis=1)
        lift = np.zeros_like(speeds)
        lift[:, 3:6] = self._gravity - gravity
        for instance, joints, qd, a in zip(instances, motion.q.tolist(), speeds.tolist(), lift.tolist(), strict=True):
            body = instance.robot
            bias.append(
                pybullet.calculateInverseDynamics(body, _NOWHERE + joints, qd, a, physicsClientId=instance.client)
            )
        return np.array(matrix), np.array(bias)[:, self._order]

    def _welded_bias(self, instance: Instance, q: list[float], qd: list[float], gravity: Array) -> list[float]:
        """Return the bias with a welded base, which the engine takes as untilted, under `gravity` (3,) in its axes."""
        body, client = instance.robot, instance.client
        tilted = not np.array_equal(gravity, self._gravity)
        if tilted:
            pybullet.setGravity(*gravity.tolist(), physicsClientId=client)
        try:
            return pybullet.calculateInverseDynamics(body, q, qd, [0.0] * len(q), physicsClientId=client)
        finally:
            if tilted:
                pybullet.setGravity(*self._gravity.tolist(), physicsClientId=client)
