"""Accelerometer, velocimeter, gyro and magnetometer: computed from link states, the same on every engine.

The accelerometer is the mean proper acceleration over the environment step, from the velocities at its two ends; a
reading from the engine's last substep would be a property of its solver rather than of the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api import kernels, rotations
from guard_api.conventions import GRAVITY, MAGNETIC_FIELD
from guard_api.model.kinematics import rows_of
from guard_api.model.robot import RobotModel, Sensor, SensorKind
from guard_api.physics.state import State
from guard_api.physics.transition import Array, Transition, in_frame
from guard_api.shapes import IDENTITY

_GRAVITY: Final = np.array(GRAVITY)
_MAGNETIC: Final = np.array(MAGNETIC_FIELD)

KINDS: Final[tuple[SensorKind, ...]] = ("accelerometer", "velocimeter", "gyro", "magnetometer")


class InertialSensors:
    """The inertial sensors of one robot; `read` is pure."""

    def __init__(self, robot: RobotModel) -> None:
        sensors = [sensor for sensor in robot.sensors if sensor.kind in KINDS]
        links = list(dict.fromkeys(str(sensor.link) for sensor in sensors))
        self._links = rows_of([robot.link_index(link) for link in links])
        self._only_root = robot.reference is None and links == [robot.root]
        self._names = [sensor.name for sensor in sensors]
        self._sites = _Sites(robot, sensors)
        self._sensors = np.array(
            [(KINDS.index(s.kind), links.index(str(s.link)), self._sites.column(s, k)) for k, s in enumerate(sensors)],
            np.int64,
        ).reshape(-1, 3)
        self._turns = {s.name: s.pose.quaternion for s in sensors if s.pose.quaternion != IDENTITY}

    @property
    def any(self) -> bool:
        """Whether the robot has such sensors."""
        return bool(self._names)

    def read(self, t: Transition) -> dict[str, Array]:
        """Return every sensor's reading by name, each (N, 3) in the axes of its site.

        accelerometer [m/s^2], (0, 0, 9.81) at rest upright; velocimeter [m/s]; gyro [rad/s]; magnetometer.
        """
        state = t.now.state
        rotation = (
            t.now.rotation[:, None] if self._only_root else rotations.to_matrix(state.link_quaternion[:, self._links])
        )
        velocity, before = self._sites.velocity(state), self._sites.velocity(t.previous.state)
        local = np.empty((len(rotation), len(self._names), 3))
        read = kernels.inertial() or _read
        arrays = (rotation, velocity, before, state.link_angular_velocity)
        read(*arrays, _GRAVITY, _MAGNETIC, t.duration, self._sensors, local)
        readings = {name: local[:, k] for k, name in enumerate(self._names)}
        for name, turn in self._turns.items():
            readings[name] = rotations.unrotate(turn, readings[name])
        return readings


class _Sites:
    """The places of S sensors: on the origins of their links, all of them, or anywhere."""

    def __init__(self, robot: RobotModel, sensors: Sequence[Sensor]) -> None:
        self._links = [robot.link_index(str(sensor.link)) for sensor in sensors]
        self._offset = np.array([sensor.pose.position for sensor in sensors]).reshape(-1, 3)
        self._shifted = bool(self._offset.any())

    def column(self, sensor: Sensor, number: int) -> int:
        """Return where the velocity that a sensor reads is: of its site, or of its link in the arrays of the state."""
        return number if self._shifted and sensor.kind in {"accelerometer", "velocimeter"} else self._links[number]

    def velocity(self, state: State) -> Array:
        """Return the velocities of all sites (N, S, 3), or of all links (N, L, 3) where every site is on its link."""
        if not self._shifted:
            return state.link_linear_velocity
        arm = rotations.rotate(state.link_quaternion[:, self._links], self._offset)
        spin = state.link_angular_velocity[:, self._links]
        return state.link_linear_velocity[:, self._links] + rotations.cross(spin, arm)


def _read(
    rotation: Array,
    velocity: Array,
    before: Array,
    angular: Array,
    gravity: Array,
    field: Array,
    duration: float,
    sensors: NDArray[np.int64],
    readings: Array,
) -> None:
    """Write the readings (N, S, 3) in the axes of the links, whose `rotation` is (N, F, 3, 3).

    velocity, before: (N, V, 3) [m/s] now and `duration` [s] ago. angular: (N, L, 3) [rad/s]. sensors: (S, 3) number of
    the kind, of the rotation, and of the column of velocity or angular.
    """
    for k, (kind, frame, column) in enumerate(sensors.tolist()):
        match KINDS[kind]:
            case "accelerometer":
                vector = (velocity[:, column] - before[:, column]) / duration - gravity
            case "velocimeter":
                vector = velocity[:, column]
            case "gyro":
                vector = angular[:, column]  # every point of a rigid link turns alike
            case _:
                vector = np.broadcast_to(field, readings[:, k].shape)  # the same everywhere
        readings[:, k] = in_frame(rotation[:, frame, None], vector[:, None, None])[:, 0, 0]
