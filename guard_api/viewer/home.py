"""The state that a robot has at home, without any engine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import RobotModel
from guard_api.physics.state import State, state_dtype, state_shapes
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start


def home_state(robot: RobotModel, joint_position: Mapping[str, float] | None = None) -> State:
    """Return one world with `robot` at rest at home, some joints at `joint_position` [rad or m] instead."""
    scene = SceneSpec(robot=robot)
    start = home_start(scene, 1)
    for name, position in (joint_position or {}).items():
        start.joint_position[:, robot.joint_index(name)] = position
    poses = Kinematics(robot).poses(start.base_position, start.base_quaternion, start.joint_position)
    arrays = {name: np.zeros(shape, state_dtype(name)) for name, shape in state_shapes(scene, 1).items()}
    arrays |= {
        "joint_position": start.joint_position,
        "link_position": poses.position,
        "link_quaternion": poses.quaternion,
        "ok": np.ones(1, bool),
    }
    return State(**arrays)
