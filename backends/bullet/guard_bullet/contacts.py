"""What touches the robot, collected over the substeps of one step."""

from __future__ import annotations

import numpy as np

from guard_api.scene.spec import SceneSpec
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet
from guard_bullet.robot import BASE

# Fields of one contact point as the engine reports it.
_BODY, _LINK, _DISTANCE, _FORCE = 2, 3, 8, 9


class ContactLog:
    """Sums normal forces on the touch links and notes the bodies that were touched.

    touch: (N, K) [N] mean over the substeps so far; body_contact: (N, B).
    """

    def __init__(self, scene: SceneSpec, num_worlds: int) -> None:
        robot = scene.robot
        touch_links = robot.touch_links if robot else ()
        solid = robot is not None and any(link.collisions for link in robot.links)
        self._column = {robot.link_index(n) + BASE: k for k, n in enumerate(touch_links)} if robot else {}
        self.needed = solid and bool(touch_links or scene.num_bodies)
        self._force = np.zeros((num_worlds, len(touch_links)))
        self._substeps = np.zeros(1, np.int64)
        self.body_contact = np.zeros((num_worlds, scene.num_bodies), bool)

    @property
    def touch(self) -> np.ndarray:
        """Mean normal force on each touch link over the substeps since `begin`: (N, K) [N]."""
        return self._force / max(int(self._substeps[0]), 1)

    def begin(self) -> None:
        """Forget the last step."""
        self._force[:], self.body_contact[:], self._substeps[:] = 0.0, False, 0

    def clear(self, mask: np.ndarray) -> None:
        """Forget the last step of the worlds where `mask` is true."""
        self._force[mask], self.body_contact[mask] = 0.0, False

    def collect(self, worlds: list[int], instances: list[Instance]) -> None:
        """Add the contacts of the substep just made in `worlds`; `instances` are all N engine instances."""
        self._substeps[0] += 1
        for world in worlds:
            instance = instances[world]
            robot = instance.robot
            for point in pybullet.getContactPoints(robot, physicsClientId=instance.client):
                other = point[_BODY]
                if other == robot:
                    continue
                column = self._column.get(point[_LINK])
                if column is not None:
                    self._force[world, column] += point[_FORCE]
                # Points that are merely near are listed too, apart and without force.
                if other in instance.bodies and (point[_FORCE] > 0.0 or point[_DISTANCE] <= 0.0):
                    self.body_contact[world, instance.bodies.index(other)] = True

    def arrays(self) -> dict[str, np.ndarray]:
        """Return what a snapshot keeps, by name."""
        return {"force": self._force, "force_substeps": self._substeps, "body_contact": self.body_contact}
