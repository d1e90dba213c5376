"""Put one world into a given state, from scratch: every number PhysX keeps between steps is written."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.physics.state import Array, Start
from guard_api.scene.spec import SceneSpec
from guard_sapien.compile import Copy
from guard_sapien.engine import physx, pose


def place(
    copy: Copy, spec: SceneSpec, joint_of_engine: Sequence[int] | NDArray[np.intp], start: Start, row: int
) -> None:
    """Write row `row` of `start` into a world. joint_of_engine: (J,) the model's number of every PhysX joint."""
    for index, component in enumerate(copy.bodies):
        at = pose(start.body_position[row, index], start.body_quaternion[row, index])
        component.entity.set_pose(at)
        if spec.bodies[index].physics == "dynamic":
            assert isinstance(component, physx.PhysxRigidDynamicComponent)
            component.set_linear_velocity(start.body_linear_velocity[row, index])
            component.set_angular_velocity(start.body_angular_velocity[row, index])
    if spec.robot is None or copy.robot is None:
        return
    engine = copy.robot.engine
    # Root before joints: the other order leaves stale link velocities.
    engine.set_root_pose(pose(start.base_position[row], start.base_quaternion[row]))
    if spec.robot.floating:
        angular = start.base_angular_velocity[row]
        arm = rotations.rotate(start.base_quaternion[row], spec.robot.links[0].com)
        # PhysX keeps the velocity of the com.
        engine.set_root_linear_velocity(start.base_linear_velocity[row] + rotations.cross(angular, arm))
        engine.set_root_angular_velocity(angular)
    if len(joint_of_engine):
        engine.set_qpos(start.joint_position[row, joint_of_engine].astype(np.float32))
        engine.set_qvel(start.joint_velocity[row, joint_of_engine].astype(np.float32))
        engine.set_qf(np.zeros(len(joint_of_engine), np.float32))


def place_static(copy: Copy, spec: SceneSpec, position: Array, quaternion: Array) -> None:
    """Put the static bodies of a world at their rows of `position` (B, 3), `quaternion` (B, 4)."""
    for index, component in enumerate(copy.bodies):
        if spec.bodies[index].physics == "static":
            component.entity.set_pose(pose(position[index], quaternion[index]))


def finite_rows(start: Start) -> NDArray[np.bool_]:
    """Return whether every number of each row of `start` is finite: (N,)."""
    arrays = [getattr(start, name) for name in Start.__dataclass_fields__]
    return np.all([np.isfinite(a.reshape(len(a), -1)).all(axis=1) for a in arrays], axis=0)
