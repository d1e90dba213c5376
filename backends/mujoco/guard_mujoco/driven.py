"""Bodies that go where they are told, at a velocity that others feel."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.errors import BackendError
from guard_mujoco.compile import CompiledScene

Array = NDArray[np.float64]


class DrivenBodies:
    """The D driven bodies of N worlds: before every step each gets the constant velocity that takes it to its target.

    Contacts slow a body down by less than 1e-6 of what it pushes (see `compile.DRIVEN_INERTIA`); the next step's
    velocity takes that back, so nothing accumulates.

    target: (N, D, 7) position and quaternion to be reached by the end of the next step.
    """

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        self._scene = compiled.scene
        self._members = compiled.free[compiled.driven]
        self._qpos, self._qvel = batch.bind("qpos"), batch.bind("qvel")
        self._at = compiled.free_qpos[compiled.driven][:, None] + np.arange(7)
        self._dof = compiled.free_dof[compiled.driven][:, None] + np.arange(6)
        self.target = self._qpos[:, self._at]

    @property
    def any(self) -> bool:
        """Whether the scene has driven bodies."""
        return len(self._members) > 0

    def hold(self, rows: NDArray[np.intp]) -> None:
        """Make the present poses of the worlds `rows` their targets."""
        self.target[rows] = self._qpos[rows][:, self._at]

    def aim(self, group: str, position: Array, quaternion: Array) -> None:
        """Set the targets of `group`: (N, count, 3), (N, count, 4). Raises BackendError when it is not driven."""
        try:
            numbers = np.arange(self._scene.num_bodies)[self._scene.body_slice(group)]
        except KeyError:
            raise BackendError(f"drive: the scene has no group {group!r}") from None
        members = np.flatnonzero(np.isin(self._members, numbers))
        if len(members) != len(numbers):
            raise BackendError(f"drive: group {group!r} is not driven")
        self.target[:, members, :3] = position
        self.target[:, members, 3:] = quaternion

    def launch(self, rows: NDArray[np.intp], duration: float) -> None:
        """Give the driven bodies of the worlds `rows` the velocity that reaches the target in `duration` [s]."""
        pose, target = self._qpos[rows][:, self._at], self.target[rows]
        turn = rotations.multiply(rotations.conjugate(pose[..., 3:]), target[..., 3:])
        velocity = np.concatenate([target[..., :3] - pose[..., :3], rotation_vector(turn)], axis=-1) / duration
        self._qvel[rows[:, None, None], self._dof] = velocity


def rotation_vector(quaternion: Array) -> Array:
    """Return axis times angle `(..., 3)` [rad] of unit quaternions, the short way round."""
    w, vector = quaternion[..., :1], quaternion[..., 1:]
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    # For small angles vector / sine * angle tends to 2 vector.
    scale = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)
    return np.where(w < 0.0, -1.0, 1.0) * scale * vector
