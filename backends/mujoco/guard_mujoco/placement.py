"""A `Start` written into the state rows of a batch."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.physics.state import Array, Start
from guard_mujoco.compile import CompiledScene


def check_start(compiled: CompiledScene, start: Start, rows: NDArray[np.intp]) -> None:
    """Raise BackendError when a base or body of the worlds `rows` is to start with a motion that it cannot have."""
    robot = compiled.scene.robot
    if robot and not robot.floating:
        _require_zero("base_linear_velocity", start.base_linear_velocity[rows], f"the {robot.base} base")
        _require_zero("base_angular_velocity", start.base_angular_velocity[rows], f"the {robot.base} base")
    if robot and robot.base == "planar":
        _require_zero("base_position", start.base_position[rows], "the planar base, which its joints place")
        _require_zero("base_quaternion", start.base_quaternion[rows][:, 1:], "the planar base, which its joints turn")
    still = np.concatenate([compiled.fixed, compiled.free[compiled.driven]])
    _require_zero("body_linear_velocity", start.body_linear_velocity[rows][:, still], "static and driven bodies")
    _require_zero("body_angular_velocity", start.body_angular_velocity[rows][:, still], "static and driven bodies")


def place(compiled: CompiledScene, batch: Batch, start: Start, rows: NDArray[np.intp]) -> None:
    """Write the worlds `rows` of `start` into the state of `batch`."""
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    each = rows[:, None]
    qpos[each, compiled.joint_qpos] = start.joint_position[rows]
    qvel[each, compiled.joint_dof] = start.joint_velocity[rows]
    if compiled.base_free:
        quaternion = start.base_quaternion[rows]
        qpos[rows, :3], qpos[rows, 3:7] = start.base_position[rows], quaternion
        qvel[rows, :3] = start.base_linear_velocity[rows]
        qvel[rows, 3:6] = rotations.unrotate(quaternion, start.base_angular_velocity[rows])
    if compiled.base_mocap is not None:
        batch.bind("mocap_pos")[rows, compiled.base_mocap] = start.base_position[rows]
        batch.bind("mocap_quat")[rows, compiled.base_mocap] = start.base_quaternion[rows]
    if len(compiled.fixed):
        batch.bind("mocap_pos")[each, compiled.fixed_mocap] = start.body_position[rows][:, compiled.fixed]
        batch.bind("mocap_quat")[each, compiled.fixed_mocap] = start.body_quaternion[rows][:, compiled.fixed]
    for body, at, dof in zip(compiled.free, compiled.free_qpos, compiled.free_dof, strict=True):
        quaternion = start.body_quaternion[rows, body]
        qpos[rows, at : at + 3], qpos[rows, at + 3 : at + 7] = start.body_position[rows, body], quaternion
        qvel[rows, dof : dof + 3] = start.body_linear_velocity[rows, body]
        qvel[rows, dof + 3 : dof + 6] = rotations.unrotate(quaternion, start.body_angular_velocity[rows, body])


def _require_zero(field: str, values: Array, what: str) -> None:
    if np.any(values):
        raise BackendError(f"Start.{field} must be zero for {what}; it has {values[np.nonzero(values)][0]:g}")
