"""What a robot feels of itself: its joints, how its links are turned against each other, and touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from guard_api import rotations
from guard_api.model.robot import RobotModel, Sensor
from guard_api.physics.transition import Array, Transition, in_frame


class Proprioception:
    """The joint, relative and touch sensors of one robot; `read` is pure.

    joint_position: (N, 2) sine and cosine of a revolute or continuous joint, (N, 1) [m] of a prismatic one.
    joint_velocity: (N, 1) [rad/s] or [m/s]. touch: (N, 1) [N], see `State.touch`.
    relative_rotation: (N, 9), row by row, the rotation matrix of a link in the axes of the nearest link before it that
    has mass. relative_angular_velocity: (N, 3) [rad/s] of the link against that other one, in the link's own axes.
    Source: GUARD's observations (sine and cosine of hinges, matrices of ball joints) and MuJoCo's `ballangvel`.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._turning, self._sliding = _joint_positions(robot)
        self._velocity = _joints(robot, _of_kind(robot, "joint_velocity"))
        self._touch = [sensor.name for sensor in robot.touch_sensors]
        self._rotation = _links(robot, _of_kind(robot, "relative_rotation"))
        self._spin = _links(robot, _of_kind(robot, "relative_angular_velocity"))

    @property
    def any(self) -> bool:
        """Whether the robot has such sensors."""
        return any((self._turning, self._sliding, self._velocity, self._touch, self._rotation, self._spin))

    def read(self, t: Transition) -> dict[str, Array]:
        """Return every sensor's reading by name; the class says of what shape."""
        state = t.now.state
        readings: dict[str, Array] = {}
        if self._turning:
            angle = state.joint_position[:, list(self._turning.values())]
            circle = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
            readings |= {name: circle[:, k] for k, name in enumerate(self._turning)}
        for values, columns in ((state.joint_position, self._sliding), (state.joint_velocity, self._velocity)):
            readings |= {name: values[:, column, None] for name, column in columns.items()}
        readings |= {name: state.touch[:, column, None] for column, name in enumerate(self._touch)}
        if self._rotation:
            child, parent = (rotations.to_matrix(state.link_quaternion[:, k]) for k in _columns(self._rotation))
            entries = in_frame(parent, child.swapaxes(2, 3)).swapaxes(2, 3).reshape(*child.shape[:2], 9)
            readings |= {name: entries[:, k] for k, name in enumerate(self._rotation)}
        if self._spin:
            links, others = _columns(self._spin)
            against = state.link_angular_velocity[:, links] - state.link_angular_velocity[:, others]
            spin = rotations.unrotate(state.link_quaternion[:, links], against)
            readings |= {name: spin[:, k] for k, name in enumerate(self._spin)}
        return readings


def _columns(pairs: dict[str, tuple[int, int]]) -> tuple[list[int], list[int]]:
    """Return the first and the second numbers of all pairs."""
    return [first for first, _ in pairs.values()], [second for _, second in pairs.values()]


def _of_kind(robot: RobotModel, kind: str) -> list[Sensor]:
    return [sensor for sensor in robot.sensors if sensor.kind == kind]


def _joints(robot: RobotModel, sensors: Sequence[Sensor]) -> dict[str, int]:
    """Return sensor name -> number of its joint."""
    return {sensor.name: robot.joint_index(str(sensor.joint)) for sensor in sensors}


def _joint_positions(robot: RobotModel) -> tuple[dict[str, int], dict[str, int]]:
    """Return name -> joint of the position sensors of joints that turn, and of those that slide."""
    joints = _joints(robot, _of_kind(robot, "joint_position"))
    slides = {name: joint for name, joint in joints.items() if robot.joints[joint].kind == "prismatic"}
    return {name: joint for name, joint in joints.items() if name not in slides}, slides


def _links(robot: RobotModel, sensors: Sequence[Sensor]) -> dict[str, tuple[int, int]]:
    """Return sensor name -> its link and the nearest link before it that is not virtual, as numbers."""
    parent = {joint.child: joint.parent for joint in robot.joints}
    pairs = {}
    for sensor in sensors:
        link = str(sensor.link)
        other = parent[link]
        while robot.links[robot.link_index(other)].virtual and other in parent:
            other = parent[other]
        pairs[sensor.name] = (robot.link_index(link), robot.link_index(other))
    return pairs
