"""How a robot stands at home, at any place and heading: what 3-D distances are measured from before physics begins."""

from __future__ import annotations

import numpy as np

from guard_api.model.kinematics import Kinematics
from guard_api.physics.state import Array, State, state_dtype, state_shapes
from guard_api.physics.transition import Snapshot, SnapshotReader
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start, place_robot


class HomeStance:
    """The robot of `scene` at home, by its kinematics alone."""

    def __init__(self, scene: SceneSpec) -> None:
        assert scene.robot is not None
        self._scene, self._robot = scene, scene.robot
        self._kinematics = Kinematics(scene.robot)
        self._reader = SnapshotReader(scene.robot)

    def __call__(self, places: Array, yaw: Array) -> Snapshot:
        """Return the robots at rest at `places` (n, 2) [m] and headings `yaw` (n,) [rad], with no bodies around."""
        start = place_robot(self._robot, home_start(self._scene, len(places)), places, yaw)
        poses = self._kinematics.poses(start.base_position, start.base_quaternion, start.joint_position)
        shapes = state_shapes(self._scene, len(places))
        arrays = {name: np.zeros(shape, state_dtype(name)) for name, shape in shapes.items()}
        arrays |= {"joint_position": start.joint_position}
        arrays |= {"link_position": poses.position, "link_quaternion": poses.quaternion}
        never = np.zeros(len(places), np.int64)
        return self._reader.read(State(**arrays), bodies={}, origins={}, slices={}, steps_since_success=never)
