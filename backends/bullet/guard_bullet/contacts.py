"""What touches the robot, collected over the substeps of one step."""

from __future__ import annotations

from math import hypot
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.touch import LinkContacts, TouchSensors
from guard_api.scene.spec import SceneSpec
from guard_api.shapes import Vector3
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet
from guard_bullet.robot import BASE, base_frame
from guard_bullet.shapes import xyzw

# Fields of one contact point as the engine reports it; the normal points into the first body, here the robot.
_BODY, _LINK, _ON_ROBOT, _ON_OTHER, _NORMAL, _DISTANCE, _FORCE = 2, 3, 5, 6, 7, 8, 9

Vector4: TypeAlias = tuple[float, float, float, float]

_NOWHERE = (0.0,) * 7
"""Position and quaternion (x, y, z, w) of a link where they decide nothing."""


class ContactLog:
    """Sums normal forces on the touch sensors and notes the bodies that were touched.

    touch: (N, K) [N] mean over the substeps of the last step; body_contact: (N, B).
    """

    def __init__(self, scene: SceneSpec, num_worlds: int) -> None:
        robot = scene.robot
        self._sensors = TouchSensors(robot)
        self._timestep = scene.timestep
        solid = robot is not None and any(link.collisions for link in robot.links)
        self.needed = solid and bool(len(self._sensors) or scene.num_bodies)
        self.touch = np.zeros((num_worlds, len(self._sensors)))
        self.body_contact = np.zeros((num_worlds, scene.num_bodies), bool)
        self._rows: list[tuple[float, ...]] = []
        self._substeps = 0
        # A floating base is held by its centre of mass and principal axes.
        floating = robot is not None and robot.floating
        com = robot.links[0].com if robot and floating else (0.0, 0.0, 0.0)
        axes = xyzw(base_frame(robot).quaternion) if robot else (0.0, 0.0, 0.0, 1.0)
        self._base_link = pybullet.invertTransform(com, axes)

    def begin(self) -> None:
        """Forget the last step."""
        self.touch[:], self.body_contact[:], self._substeps = 0.0, False, 0

    def clear(self, mask: NDArray[np.bool_]) -> None:
        """Forget the last step of the worlds where `mask` is true."""
        self.touch[mask], self.body_contact[mask] = 0.0, False

    def collect(self, worlds: list[int], instances: list[Instance]) -> None:
        """Note the contacts of the substep just made in `worlds`; `instances` are all N engine instances."""
        self._substeps += 1
        sensed = self._sensors.links
        for world in worlds:
            instance = instances[world]
            robot, frames = instance.robot, {}
            for point in pybullet.getContactPoints(robot, physicsClientId=instance.client):
                other, force = point[_BODY], point[_FORCE]
                if other == robot:
                    continue
                link = point[_LINK] - BASE
                if force > 0.0 and link in sensed:
                    if link not in frames:
                        frames[link] = self._frame(instance, link)
                    place = (*point[_ON_ROBOT], *point[_ON_OTHER], *point[_NORMAL])
                    self._rows.append((world, link, force, *place, *frames[link]))
                # Points that are merely near are listed too, apart and without force.
                if other in instance.bodies and (force > 0.0 or point[_DISTANCE] <= 0.0):
                    self.body_contact[world, instance.bodies.index(other)] = True

    def finish(self) -> None:
        """Put the contacts of all substeps since `begin` through the rule of the touch sensors."""
        if not self._rows:
            return
        rows = np.array(self._rows)
        self._rows.clear()
        place, frame = rows[:, 3:12], rows[:, 12:]
        contacts = LinkContacts(
            world=rows[:, 0].astype(np.intp),
            link=rows[:, 1].astype(np.intp),
            force=rows[:, 2],
            point=0.5 * (place[:, 0:3] + place[:, 3:6]),
            normal=-place[:, 6:9],
            position=frame[:, 0:3],
            quaternion=frame[:, [6, 3, 4, 5]],
        )
        self.touch[:] = self._sensors.force(contacts, len(self.touch)) / self._substeps

    def arrays(self) -> dict[str, NDArray]:
        """Return what a snapshot keeps, by name."""
        return {"touch": self.touch, "body_contact": self.body_contact}

    def _frame(self, instance: Instance, link: int) -> tuple[float, ...]:
        """Return a link's position and quaternion when the engine looked for contacts: before it moved the links."""
        if link not in self._sensors.located:
            return _NOWHERE
        robot, client = instance.robot, instance.client
        if link > 0:
            # The engine itself brings these frames up to date only when it looks for contacts the next time.
            position, quaternion = pybullet.getLinkState(robot, link + BASE, physicsClientId=client)[4:6]
        else:
            position, quaternion = pybullet.getBasePositionAndOrientation(robot, client)
            linear, angular = pybullet.getBaseVelocity(robot, client)
            position, quaternion = moved_back(position, quaternion, linear, angular, self._timestep)
            position, quaternion = pybullet.multiplyTransforms(position, quaternion, *self._base_link)
        return (*position, *quaternion)


def moved_back(
    position: Vector3, quaternion: Vector4, linear: Vector3, angular: Vector3, duration: float
) -> tuple[Vector3, Vector4]:
    """Return the pose, quaternion (x, y, z, w), from which a body came: the inverse of the engine's integration."""
    x, y, z = (p - duration * v for p, v in zip(position, linear, strict=True))
    angle = -duration * hypot(*angular)
    if angle == 0.0:
        return (x, y, z), quaternion
    turn = pybullet.getQuaternionFromAxisAngle(angular, angle)
    return (x, y, z), pybullet.multiplyTransforms((0.0, 0.0, 0.0), turn, (0.0, 0.0, 0.0), quaternion)[1]
