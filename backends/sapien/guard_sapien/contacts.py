"""Who touches the robot, and how hard: PhysX's contact list after each substep."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.touch import LinkContacts, TouchSensors
from guard_api.scene.spec import SceneSpec
from guard_sapien.articulation import can_collide, ignored_bits
from guard_sapien.compile import Copy
from guard_sapien.engine import physx

_POSE = 7
"""Numbers per entity in `Scene.pack_poses()`: quaternion, position."""

_ANYWHERE = (0.0,) * (3 + 3 + 1)
"""Point, normal, and which of the noted poses is that of the link's world: where they decide nothing."""


class ContactLog:
    """The contacts of N robots, noted substep by substep.

    impulse: (N, K) [N s] that each touch sensor counted since `begin`. touched: (N, B) which bodies were touched. Both
    arrays belong to the caller and are written in place.
    """

    def __init__(
        self, spec: SceneSpec, copies: Sequence[Copy], impulse: NDArray[np.float64], touched: NDArray[np.bool_]
    ) -> None:
        self._impulse, self._touched = impulse, touched
        self._sensors, self._first_link = TouchSensors(spec.robot), copies[0].first_link
        self._things = [_Things(copy) for copy in copies]
        self._before = [b""] * len(copies)
        self._rows: list[tuple[float, ...]] = []
        self._poses: list[bytes] = []

    def renew(self, world: int, copy: Copy) -> None:
        """Take note that `world` was built anew as `copy`."""
        self._things[world] = _Things(copy)

    def prepare(self, worlds: Sequence[int]) -> None:
        """Note where the links are before a substep: there PhysX looks for its contacts."""
        if self._sensors.located:
            for world in worlds:
                self._before[world] = self._things[world].pack_poses()

    def collect(self, world: int) -> None:
        """Note the contacts of the substep just made in `world`."""
        things, touched, sensors = self._things[world], self._touched[world], self._sensors
        needs_poses = True
        for contact in things.get_contacts():
            first, second = contact.bodies
            if (first in things.links) == (second in things.links):
                continue  # the robot with itself, or without the robot
            # The normal points into the first body.
            link, other, outward = (first, second, -1.0) if first in things.links else (second, first, 1.0)
            number, index = things.links[link], things.bodies.get(other)
            if number not in sensors.links and (index is None or touched[index]):
                continue
            for point in contact.points:
                impulse = hypot(*point.impulse.tolist())  # PhysX reports its normal part only
                if impulse > 0.0 and number in sensors.links:
                    place = _ANYWHERE
                    if number in sensors.located:
                        if needs_poses:
                            self._poses.append(self._before[world])
                            needs_poses = False
                        normal = [outward * x for x in point.normal.tolist()]
                        place = (*point.position.tolist(), *normal, len(self._poses) - 1)
                    self._rows.append((world, number, impulse, *place))
                if index is not None and (impulse > 0.0 or point.separation <= 0.0):
                    touched[index] = True

    def finish(self) -> None:
        """Put all contacts noted since the last call through the rule of the touch sensors."""
        if not self._rows:
            return
        rows = np.array(self._rows)
        world, link, at = (rows[:, column].astype(np.intp) for column in (0, 1, 9))
        poses = np.zeros((len(rows), _POSE))
        if self._poses:
            noted = np.frombuffer(b"".join(self._poses), np.float32).reshape(len(self._poses), -1, _POSE)
            poses = noted[at, self._first_link + link].astype(float)
        contacts = LinkContacts(
            world=world,
            link=link,
            force=rows[:, 2],  # as an impulse, and so is the sum
            point=rows[:, 3:6],
            normal=rows[:, 6:9],
            position=poses[:, 4:],
            quaternion=poses[:, :4],
        )
        self._impulse += self._sensors.force(contacts, len(self._impulse))
        self._rows.clear()
        self._poses.clear()


class _Things:
    """What PhysX's contacts of one world speak of: it hands out the same Python object for the same body every time.

    links, bodies: component -> number of the link in the model's order, of the scene's body.
    """

    def __init__(self, copy: Copy) -> None:
        assert copy.robot is not None
        self.get_contacts, self.pack_poses = copy.system.get_contacts, copy.scene.pack_poses
        self.links: dict[physx.PhysxRigidBaseComponent, int] = {c: k for k, c in enumerate(copy.robot.links)}
        self.bodies: dict[physx.PhysxRigidBaseComponent, int] = {c: k for k, c in enumerate(copy.bodies)}


def wanted(spec: SceneSpec) -> bool:
    """Return whether `State` has a contact quantity that can ever be anything but zero in this scene."""
    robot = spec.robot
    if robot is None or not can_collide(spec, robot, ignored_bits(robot)):
        return False
    return bool(robot.touch_sensors) or spec.num_bodies > 0
