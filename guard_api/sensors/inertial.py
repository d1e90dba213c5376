"""Accelerometer, velocimeter, gyro and magnetometer: computed from link states, the same on every engine.

The accelerometer is the mean proper acceleration over the environment step, from the velocities at its two ends; a
reading from the engine's last substep would be a property of its solver rather than of the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from guard_api import rotations
from guard_api.conventions import GRAVITY, MAGNETIC_FIELD
from guard_api.model.robot import RobotModel, Sensor, SensorKind
from guard_api.physics.state import State
from guard_api.physics.transition import Array, Transition, in_frame
from guard_api.shapes import IDENTITY, ORIGIN

_GRAVITY: Final = np.array(GRAVITY)
_MAGNETIC: Final = np.array(MAGNETIC_FIELD)


class InertialSensors:
    """The inertial sensors of one robot, grouped by link so that each link's frame is applied once; `read` is pure."""

    def __init__(self, robot: RobotModel) -> None:
        self._root = robot.link_index(robot.root) if robot.reference is None else -1
        self._on_link: dict[int, list[Sensor]] = {}
        for sensor in robot.sensors:
            self._on_link.setdefault(robot.link_index(str(sensor.link)), []).append(sensor)

    def read(self, t: Transition) -> dict[str, Array]:
        """Return every sensor's reading by name, each (N, 3) in the axes of its site.

        accelerometer [m/s^2], (0, 0, 9.81) at rest upright; velocimeter [m/s]; gyro [rad/s]; magnetometer.
        """
        readings: dict[str, Array] = {}
        for link, sensors in self._on_link.items():
            world = np.empty((len(t.now.position), len(sensors), 3))
            for i, sensor in enumerate(sensors):
                world[:, i] = _WORLD_VECTOR[sensor.kind](t, sensor, link)
            at_root = link == self._root
            rotation = t.now.rotation if at_root else rotations.to_matrix(t.now.state.link_quaternion[:, link])
            local = in_frame(rotation, world)
            for i, sensor in enumerate(sensors):
                turned = sensor.pose.quaternion != IDENTITY
                reading = local[:, i]
                readings[sensor.name] = rotations.unrotate(sensor.pose.quaternion, reading) if turned else reading
        return readings


def _site_velocity(state: State, sensor: Sensor, link: int) -> Array:
    """Return the velocity of the sensor's site, world axes: (N, 3) [m/s]."""
    velocity = state.link_linear_velocity[:, link]
    if sensor.pose.position == ORIGIN:
        return velocity
    arm = rotations.rotate(state.link_quaternion[:, link], sensor.pose.position)
    return velocity + rotations.cross(state.link_angular_velocity[:, link], arm)


def _acceleration(t: Transition, sensor: Sensor, link: int) -> Array:
    change = _site_velocity(t.now.state, sensor, link) - _site_velocity(t.previous.state, sensor, link)
    return change / t.duration - _GRAVITY


def _velocity(t: Transition, sensor: Sensor, link: int) -> Array:
    return _site_velocity(t.now.state, sensor, link)


def _angular_velocity(t: Transition, sensor: Sensor, link: int) -> Array:
    del sensor  # every point of a rigid link turns alike
    return t.now.state.link_angular_velocity[:, link]


def _magnetic_field(t: Transition, sensor: Sensor, link: int) -> Array:
    del t, sensor, link  # the field is the same everywhere
    return _MAGNETIC


_WORLD_VECTOR: Final[dict[SensorKind, Callable[[Transition, Sensor, int], Array]]] = {
    "accelerometer": _acceleration,
    "velocimeter": _velocity,
    "gyro": _angular_velocity,
    "magnetometer": _magnetic_field,
}
