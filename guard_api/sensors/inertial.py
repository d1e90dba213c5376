"""Accelerometer, velocimeter, gyro and magnetometer: computed from link states, the same on every engine.

The accelerometer is the mean proper acceleration over the environment step, from the velocities at its two ends; a
reading from the engine's last substep would be a property of its solver rather than of the motion.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api import kernels, rotations
from guard_api.conventions import GRAVITY, MAGNETIC_FIELD
from guard_api.model.robot import RobotModel, SensorKind
from guard_api.physics.state import State
from guard_api.physics.transition import Array, Transition
from guard_api.shapes import IDENTITY

_GRAVITY: Final = np.array(GRAVITY)
_MAGNETIC: Final = np.array(MAGNETIC_FIELD)

KINDS: Final[tuple[SensorKind, ...]] = ("accelerometer", "velocimeter", "gyro", "magnetometer")


class InertialSensors:
    """The inertial sensors of one robot; `read` is pure."""

    def __init__(self, robot: RobotModel) -> None:
        sensors = [sensor for sensor in robot.sensors if sensor.kind in KINDS]
        self._names = [sensor.name for sensor in sensors]
        places = [(KINDS.index(sensor.kind), robot.link_index(str(sensor.link))) for sensor in sensors]
        self._sensors = np.array(places, np.int64).reshape(-1, 2)
        self._offset = np.array([sensor.pose.position for sensor in sensors], float).reshape(-1, 3)
        self._turns = {s.name: s.pose.quaternion for s in sensors if s.pose.quaternion != IDENTITY}

    @property
    def any(self) -> bool:
        """Whether the robot has such sensors."""
        return bool(self._names)

    def read(self, t: Transition) -> dict[str, Array]:
        """Return every sensor's reading by name, each (N, 3) in the axes of its site.

        accelerometer [m/s^2], (0, 0, 9.81) at rest upright; velocimeter [m/s]; gyro [rad/s]; magnetometer.
        """
        now, before = t.now.state, t.previous.state
        local = np.empty((len(now.time), len(self._names), 3))
        read = kernels.inertial() or _read
        constants = (_GRAVITY, _MAGNETIC, t.duration, self._sensors, self._offset)
        read(*_links(now), *_links(before), *constants, local)
        readings = {name: local[:, k] for k, name in enumerate(self._names)}
        for name, turn in self._turns.items():
            readings[name] = rotations.unrotate(turn, readings[name])
        return readings


def _links(state: State) -> tuple[Array, Array, Array]:
    """Return quaternion (N, L, 4), linear [m/s] and angular [rad/s] velocity (N, L, 3) of all links."""
    return state.link_quaternion, state.link_linear_velocity, state.link_angular_velocity


def _read(
    quaternion: Array,
    velocity: Array,
    angular: Array,
    old_quaternion: Array,
    old_velocity: Array,
    old_angular: Array,
    gravity: Array,
    field: Array,
    duration: float,
    sensors: NDArray[np.int64],
    offset: Array,
    readings: Array,
) -> None:
    """Write the readings (N, S, 3) in the axes of the links.

    The first three are `_links` now, the next three a `duration` [s] ago. sensors (S, 2): number of the kind, and of
    the link; offset (S, 3) [m] of the site in its axes.
    """

    def site(k: int, s: int, q: Array, v: Array, turn: Array) -> Array:
        return v[:, k] + rotations.cross(turn[:, k], rotations.rotate(q[:, k], offset[s]))

    for s, (kind, k) in enumerate(sensors.tolist()):
        here = site(k, s, quaternion, velocity, angular)
        match KINDS[kind]:
            case "accelerometer":
                vector = (here - site(k, s, old_quaternion, old_velocity, old_angular)) / duration - gravity
            case "velocimeter":
                vector = here
            case "gyro":
                vector = angular[:, k]  # every point of a rigid link turns alike
            case _:
                vector = np.broadcast_to(field, here.shape)  # the same everywhere
        readings[:, s] = rotations.unrotate(quaternion[:, k], vector)
