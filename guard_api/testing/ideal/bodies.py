"""Bodies that nothing touches: dynamic ones fall and spin freely, driven ones go where they are told."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.inertia import of_shape
from guard_api.scene.spec import BodySpec, SceneSpec

Array = NDArray[np.float64]


class FreeBodies:
    """The motion of the bodies of `scene`, from arrays named as in `State` and with the same shapes.

    dynamic: (B, 1) which bodies fall.
    """

    def __init__(self, scene: SceneSpec) -> None:
        kinds = np.array([body.physics for body in scene.bodies], dtype="U7")[:, None]
        self.dynamic, self._driven = kinds == "dynamic", kinds == "driven"
        self._timestep, self._gravity = scene.timestep, np.array(scene.gravity)
        self._inertia = np.array([_inertia(body) for body in scene.bodies]).reshape(-1, 3, 3)
        self._inverse = np.linalg.inv(self._inertia)
        self._decay = np.exp(-scene.timestep * np.array([body.damping for body in scene.bodies]))[:, None]

    def fall(self, now: Mapping[str, Array]) -> dict[str, Array]:
        """Return what a timestep of free fall changes; undamped, the spin changes so that angular momentum does not."""
        h, quaternion = self._timestep, now["body_quaternion"]
        linear = self._decay * (now["body_linear_velocity"] + h * self._gravity)
        spin = rotations.unrotate(quaternion, self._decay * now["body_angular_velocity"])
        momentum = rotations.rotate(quaternion, (self._inertia * spin[..., None, :]).sum(axis=-1))
        quaternion = turned(quaternion, h * self._decay * now["body_angular_velocity"])
        spin = (self._inverse * rotations.unrotate(quaternion, momentum)[..., None, :]).sum(axis=-1)
        fallen = {
            "body_position": now["body_position"] + h * linear,
            "body_quaternion": quaternion,
            "body_linear_velocity": linear,
            "body_angular_velocity": rotations.rotate(quaternion, spin),
        }
        return {name: np.where(self.dynamic, array, now[name]) for name, array in fallen.items()}

    def drive(self, now: Mapping[str, Array], before: Mapping[str, Array], duration: float) -> dict[str, Array]:
        """Return driven bodies at their targets, with the constant velocity that took them there from `before`."""
        turn = rotation_vector(before["body_quaternion"], now["target_quaternion"])
        driven = {
            "body_position": now["target_position"],
            "body_quaternion": now["target_quaternion"],
            "body_linear_velocity": (now["target_position"] - before["body_position"]) / duration,
            "body_angular_velocity": turn / duration,
        }
        return {name: np.where(self._driven, array, now[name]) for name, array in driven.items()}


def turned(quaternion: Array, vector: Array) -> Array:
    """Return `quaternion` (..., 4) turned further by the rotation vector `vector` (..., 3) [rad], world axes."""
    angle = np.sqrt((vector * vector).sum(axis=-1))
    axis = vector / np.maximum(angle, np.finfo(float).tiny)[..., None]
    product = rotations.multiply(rotations.from_axis_angle(axis, angle), quaternion)
    return product / np.sqrt((product * product).sum(axis=-1, keepdims=True))


def rotation_vector(start: Array, end: Array) -> Array:
    """Return the shortest rotation from `start` to `end`, unit (..., 4), as a vector (..., 3) [rad], world axes."""
    turn = rotations.multiply(end, rotations.conjugate(start))
    turn = np.where(turn[..., :1] < 0.0, -turn, turn)
    sine = np.sqrt((turn[..., 1:] ** 2).sum(axis=-1, keepdims=True))
    return turn[..., 1:] * (2.0 * np.arctan2(sine, turn[..., :1]) / np.maximum(sine, np.finfo(float).tiny))


def _inertia(body: BodySpec) -> Array:
    """Return the inertia (3, 3) of the solid shape; bodies that are not dynamic never use theirs."""
    if body.physics != "dynamic":
        return np.eye(3)
    unit = of_shape(body.shape, 1.0)
    return np.array(unit.inertia) * (body.mass / unit.mass)
