"""Where an episode begins: the robot at home, and at any place and heading whatever its base is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import PLANAR_JOINTS, RobotModel
from guard_api.physics.state import Start
from guard_api.scene.spec import SceneSpec

Array = NDArray[np.float64]


def home_start(scene: SceneSpec, num_worlds: int) -> Start:
    """Return N worlds at rest: the robot at home over the origin, every body at the origin at its own height."""
    robot, zero = scene.robot, np.zeros((num_worlds, 3))
    joint = np.zeros((num_worlds, len(robot.joints) if robot else 0))
    base = np.zeros((num_worlds, 3))
    if robot:
        for name, position in robot.home.joint_position.items():
            joint[:, robot.joint_index(name)] = position
        # A planar robot's height is in its links; its base pose is the identity.
        base[:, 2] = 0.0 if robot.base == "planar" else robot.home.height
    body = np.zeros((num_worlds, scene.num_bodies, 3))
    body[:, :, 2] = [spec.height for spec in scene.bodies]
    return Start(
        base_position=base,
        base_quaternion=rotations.yaw_quaternion(np.zeros(num_worlds)),
        base_linear_velocity=zero,
        base_angular_velocity=zero.copy(),
        joint_position=joint,
        joint_velocity=np.zeros_like(joint),
        body_position=body,
        body_quaternion=rotations.yaw_quaternion(np.zeros((num_worlds, scene.num_bodies))),
        body_linear_velocity=np.zeros_like(body),
        body_angular_velocity=np.zeros_like(body),
    )


def place_robot(robot: RobotModel, start: Start, xy: Array, yaw: Array) -> Start:
    """Return `start` with the robot's base at `xy` (N, 2) [m] and heading `yaw` (N,) [rad], otherwise unchanged.

    A fixed or floating base keeps its height and gets the heading as its whole orientation; a planar base keeps the
    identity pose and gets both through its joints.
    """
    if robot.base == "planar":
        joint = start.joint_position.copy()
        joint[:, [robot.joint_index(name) for name in PLANAR_JOINTS]] = np.column_stack([xy, yaw])
        return replace(start, joint_position=joint)
    position = np.column_stack([xy, start.base_position[:, 2]])
    return replace(start, base_position=position, base_quaternion=rotations.yaw_quaternion(yaw))
