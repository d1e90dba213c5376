"""The robot's coordinates in all worlds: written to the engine at a reset, read back after every substep."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.physics.state import Start, is_sound
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet
from guard_bullet.robot import base_frame
from guard_bullet.shapes import xyzw

Array = NDArray[np.float64]

FIELDS = ("q", "qd", "base_position", "base_quaternion", "base_linear", "base_angular")


class RobotMotion:
    """Joint and base coordinates of N worlds in GUARD's conventions, mirrored from the engine.

    q, qd: (N, J).
    base_position, base_linear, base_angular: (N, 3), base_quaternion: (N, 4) of the first link's frame, world axes.
    sound: (N,) False once the engine's numbers of a world were not; the arrays keep the last sound ones.
    The engine speaks of the base's centre of mass and principal axes instead; only a floating base moves.
    """

    def __init__(self, robot: RobotModel, num_worlds: int) -> None:
        joints = len(robot.joints)
        self.q, self.qd = np.zeros((num_worlds, joints)), np.zeros((num_worlds, joints))
        self.base_position, self.base_quaternion = np.zeros((num_worlds, 3)), np.zeros((num_worlds, 4))
        self.base_quaternion[:, 0] = 1.0
        self.base_linear, self.base_angular = np.zeros((num_worlds, 3)), np.zeros((num_worlds, 3))
        self.sound = np.ones(num_worlds, bool)
        self.floating = robot.floating
        base = robot.links[0]
        self._com = np.array(base.com) if robot.floating else np.zeros(3)
        self._axes = np.array(base_frame(robot).quaternion)
        self._from_axes = rotations.conjugate(self._axes)

    def start(self, mask: NDArray[np.bool_], start: Start) -> None:
        """Take the rows of `start` where `mask` is true."""
        self.q[mask], self.qd[mask] = start.joint_position[mask], start.joint_velocity[mask]
        self.base_position[mask], self.base_quaternion[mask] = start.base_position[mask], start.base_quaternion[mask]
        self.base_linear[mask] = start.base_linear_velocity[mask]
        self.base_angular[mask] = start.base_angular_velocity[mask]
        self.sound[mask] = True

    def write(self, world: int, instance: Instance) -> None:
        """Put world number `world` into its engine instance."""
        robot, client = instance.robot, instance.client
        position, quaternion, linear, angular = (row[world] for row in self.engine_base())
        pybullet.resetBasePositionAndOrientation(robot, position.tolist(), xyzw(quaternion), physicsClientId=client)
        if self.floating:
            pybullet.resetBaseVelocity(robot, linear.tolist(), angular.tolist(), physicsClientId=client)
        if instance.joints:
            q = [[value] for value in self.q[world].tolist()]
            qd = [[value] for value in self.qd[world].tolist()]
            pybullet.resetJointStatesMultiDof(robot, instance.joints, q, qd, physicsClientId=client)

    def read_joints(self, worlds: list[int], instances: list[Instance]) -> None:
        """Fetch the joints of `worlds`; `instances` are all N engine instances."""
        if not worlds or not self.q.shape[1]:
            return
        read, rows = pybullet.getJointStates, []
        for world in worlds:
            instance = instances[world]
            rows.append([state[:2] for state in read(instance.robot, instance.joints, instance.client)])
        joints = np.array(rows).reshape(len(worlds), self.q.shape[1], 2)
        worlds, joints = self._only_sound(worlds, joints, joints[:, :, 1])
        self.q[worlds], self.qd[worlds] = joints[:, :, 0], joints[:, :, 1]

    def read_base(self, worlds: list[int], instances: list[Instance]) -> None:
        """Fetch the floating base of `worlds`; a fixed base stays where the start put it."""
        if not worlds or not self.floating:
            return
        rows = []
        for world in worlds:
            body, client = instances[world].robot, instances[world].client
            position, orientation = pybullet.getBasePositionAndOrientation(body, client)
            linear, angular = pybullet.getBaseVelocity(body, client)
            rows.append((*position, orientation[3], *orientation[:3], *linear, *angular))
        numbers = np.array(rows).reshape(-1, 13)
        worlds, numbers = self._only_sound(worlds, numbers, numbers[:, 7:])
        quaternion = rotations.multiply(numbers[:, 3:7], self._from_axes)
        arm = rotations.rotate(quaternion, self._com)
        angular = numbers[:, 10:13]
        self.base_position[worlds] = numbers[:, 0:3] - arm
        self.base_quaternion[worlds] = quaternion
        self.base_linear[worlds] = numbers[:, 7:10] - rotations.cross(angular, arm)
        self.base_angular[worlds] = angular

    def engine_base(self) -> tuple[Array, Array, Array, Array]:
        """Return pose (N, 3), (N, 4) and velocities (N, 3), (N, 3) of the base's centre of mass and principal axes."""
        arm = rotations.rotate(self.base_quaternion, self._com)
        position = self.base_position + arm
        quaternion = rotations.multiply(self.base_quaternion, self._axes)
        linear = self.base_linear + rotations.cross(self.base_angular, arm)
        return position, quaternion, linear, self.base_angular

    def only(self, world: int) -> RobotMotion:
        """Return a copy that holds nothing but world number `world`."""
        one = copy(self)
        for name in (*FIELDS, "sound"):
            setattr(one, name, getattr(self, name)[world : world + 1].copy())
        return one

    def _only_sound(self, worlds: list[int], numbers: Array, speeds: Array) -> tuple[list[int], Array]:
        """Return those of `worlds` whose rows of `numbers`, with `speeds` among them, are sound, and these rows."""
        sound = is_sound(numbers, speeds)
        if sound.all():
            return worlds, numbers
        kept = np.asarray(worlds)
        self.sound[kept[~sound]] = False
        return kept[sound].tolist(), numbers[sound]
