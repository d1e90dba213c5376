"""Accelerometer, velocimeter, gyro and magnetometer: computed from link states, the same on every engine.

The accelerometer is the mean proper acceleration over the environment step, from the velocities at its two ends; a
reading from the engine's last substep would be a property of its solver rather than of the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from guard_api import rotations
from guard_api.conventions import GRAVITY, MAGNETIC_FIELD
from guard_api.model.kinematics import rows_of
from guard_api.model.robot import RobotModel, Sensor, SensorKind
from guard_api.physics.state import State
from guard_api.physics.transition import Array, Transition, in_frame
from guard_api.shapes import IDENTITY

_GRAVITY: Final = np.array(GRAVITY)
_MAGNETIC: Final = np.array(MAGNETIC_FIELD)


class InertialSensors:
    """The inertial sensors of one robot, every kind on all links at once; `read` is pure."""

    def __init__(self, robot: RobotModel) -> None:
        inertial = [sensor for sensor in robot.sensors if sensor.kind in _WORLD_VECTORS]
        links = list(dict.fromkeys(str(sensor.link) for sensor in inertial))
        self._links = rows_of([robot.link_index(link) for link in links])
        self._only_root = robot.reference is None and links == [robot.root]
        on_link = [[sensor for sensor in inertial if sensor.link == link] for link in links]
        # World vectors lie in one array (N, links, slots, 3), so that all frames are applied in one product.
        self._slots = max(map(len, on_link), default=0)
        place = {sensor.name: (i, slot) for i, on in enumerate(on_link) for slot, sensor in enumerate(on)}
        self._kinds = [
            (vectors, _Sites(robot, sensors), [place[sensor.name] for sensor in sensors])
            for kind, vectors in _WORLD_VECTORS.items()
            if (sensors := [sensor for sensor in inertial if sensor.kind == kind])
        ]
        turns = {s.name: None if s.pose.quaternion == IDENTITY else s.pose.quaternion for s in inertial}
        self._readings = [(name, *at, turns[name]) for name, at in place.items()]

    def read(self, t: Transition) -> dict[str, Array]:
        """Return every sensor's reading by name, each (N, 3) in the axes of its site.

        accelerometer [m/s^2], (0, 0, 9.81) at rest upright; velocimeter [m/s]; gyro [rad/s]; magnetometer.
        """
        if not self._readings:
            return {}
        state = t.now.state
        rotation = (
            t.now.rotation[:, None] if self._only_root else rotations.to_matrix(state.link_quaternion[:, self._links])
        )
        world = np.empty((*rotation.shape[:2], self._slots, 3))  # slots that no sensor has are never read
        for vectors_of, sites, places in self._kinds:
            vectors = vectors_of(t, sites)
            for column, (link, slot) in enumerate(places):
                world[:, link, slot] = vectors[:, column]
        local = in_frame(rotation, world)
        return {
            name: local[:, link, slot] if turn is None else rotations.unrotate(turn, local[:, link, slot])
            for name, link, slot, turn in self._readings
        }


class _Sites:
    """The places of all S sensors of one kind."""

    def __init__(self, robot: RobotModel, sensors: Sequence[Sensor]) -> None:
        self.field = np.tile(_MAGNETIC, (1, len(sensors), 1))
        self.links = rows_of([robot.link_index(str(sensor.link)) for sensor in sensors])
        self.offset = np.array([sensor.pose.position for sensor in sensors])
        self._shifted = bool(self.offset.any())

    def velocity(self, state: State) -> Array:
        """Return the velocities of the sites, world axes: (N, S, 3) [m/s]."""
        velocity = state.link_linear_velocity[:, self.links]
        if not self._shifted:
            return velocity
        arm = rotations.rotate(state.link_quaternion[:, self.links], self.offset)
        return velocity + rotations.cross(state.link_angular_velocity[:, self.links], arm)


def _acceleration(t: Transition, sites: _Sites) -> Array:
    return (sites.velocity(t.now.state) - sites.velocity(t.previous.state)) / t.duration - _GRAVITY


def _velocity(t: Transition, sites: _Sites) -> Array:
    return sites.velocity(t.now.state)


def _angular_velocity(t: Transition, sites: _Sites) -> Array:
    return t.now.state.link_angular_velocity[:, sites.links]  # every point of a rigid link turns alike


def _magnetic_field(t: Transition, sites: _Sites) -> Array:
    del t  # the field is the same everywhere
    return sites.field


_WORLD_VECTORS: Final[dict[SensorKind, Callable[[Transition, _Sites], Array]]] = {
    "accelerometer": _acceleration,
    "velocimeter": _velocity,
    "gyro": _angular_velocity,
    "magnetometer": _magnetic_field,
}
