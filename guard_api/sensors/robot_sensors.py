"""All sensors of one robot: those that feel motion through the world, and those that feel the robot itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from guard_api.model.robot import RobotModel, SensorKind
from guard_api.physics.transition import Array, Transition
from guard_api.sensors.inertial import InertialSensors
from guard_api.sensors.proprioception import Proprioception

_INERTIAL: Final[frozenset[SensorKind]] = frozenset({"accelerometer", "velocimeter", "gyro", "magnetometer"})


class RobotSensors:
    """The sensors in `RobotModel.sensors`; `read` is pure."""

    def __init__(self, robot: RobotModel) -> None:
        inertial = tuple(sensor for sensor in robot.sensors if sensor.kind in _INERTIAL)
        self._inertial = InertialSensors(replace(robot, sensors=inertial))
        self._proprioception = Proprioception(robot) if len(inertial) < len(robot.sensors) else None

    def read(self, t: Transition) -> dict[str, Array]:
        """Return every sensor's reading by name: (N, k), as `InertialSensors` and `Proprioception` say."""
        readings = self._inertial.read(t)
        if self._proprioception is not None:
            readings |= self._proprioception.read(t)
        return readings
