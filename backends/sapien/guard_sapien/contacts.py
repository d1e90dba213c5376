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

Row = tuple[float, ...]

_ANYWHERE: Row = (0.0,) * (3 + 3 + 13)
"""Point, normal and the motion of the link (see `_motion`), where they decide nothing."""


class ContactLog:
    """The contacts of N robots, noted substep by substep.

    impulse: (N, K) [N s] that each touch sensor counted since `begin`. touched: (N, B) which bodies were touched. Both
    arrays belong to the caller and are written in place.
    """

    def __init__(
        self, spec: SceneSpec, copies: Sequence[Copy], impulse: NDArray[np.float64], touched: NDArray[np.bool_]
    ) -> None:
        self._impulse, self._touched = impulse, touched
        self._sensors, self._timestep = TouchSensors(spec.robot), spec.timestep
        self._things = [_Things(copy) for copy in copies]
        self._rows: list[Row] = []

    def renew(self, world: int, copy: Copy) -> None:
        """Take note that `world` was built anew as `copy`."""
        self._things[world] = _Things(copy)

    def collect(self, world: int) -> None:
        """Note the contacts of the substep just made in `world`."""
        things, touched, sensors = self._things[world], self._touched[world], self._sensors
        motions: dict[int, Row] = {}
        for contact in things.get_contacts():
            first, second = contact.bodies
            if (first in things.links) == (second in things.links):
                continue  # the robot with itself, or without the robot
            # The normal points into the first body.
            link, other, outward = (first, second, -1.0) if first in things.links else (second, first, 1.0)
            number, index = things.links[link], things.bodies.get(other)
            for point in contact.points:
                impulse = hypot(*point.impulse)  # PhysX reports its normal part only
                if impulse > 0.0 and number in sensors.links:
                    place = _ANYWHERE
                    if number in sensors.located:
                        if number not in motions:
                            motions[number] = _motion(things.components[number])
                        normal = (outward * x for x in point.normal)
                        place = (*point.position, *normal, *motions[number])
                    self._rows.append((world, number, impulse, *place))
                if index is not None and (impulse > 0.0 or point.separation <= 0.0):
                    touched[index] = True

    def finish(self) -> None:
        """Put all contacts noted since the last call through the rule of the touch sensors."""
        if not self._rows:
            return
        rows = np.array(self._rows)
        self._rows.clear()
        contacts = LinkContacts(
            world=rows[:, 0].astype(np.intp),
            link=rows[:, 1].astype(np.intp),
            force=rows[:, 2],  # as an impulse, and so is the sum
            point=rows[:, 3:6],
            normal=rows[:, 6:9],
            position=rows[:, 9:12],
            quaternion=rows[:, 12:16],
            com_velocity=rows[:, 16:19],
            angular_velocity=rows[:, 19:22],
            age=self._timestep,  # contacts are found before the engine moves the links
        )
        self._impulse += self._sensors.force(contacts, len(self._impulse))


class _Things:
    """What PhysX's contacts of one world speak of: it hands out the same Python object for the same body every time.

    components: (L,) the links in the model's order. links, bodies: component -> number of the link, of the scene body.
    """

    def __init__(self, copy: Copy) -> None:
        assert copy.robot is not None
        self.get_contacts = copy.system.get_contacts
        self.components = copy.robot.links
        self.links: dict[physx.PhysxRigidBaseComponent, int] = {c: k for k, c in enumerate(copy.robot.links)}
        self.bodies: dict[physx.PhysxRigidBaseComponent, int] = {c: k for k, c in enumerate(copy.bodies)}


def _motion(link: physx.PhysxArticulationLinkComponent) -> Row:
    """Return position (3), quaternion (4), velocity of the centre of mass (3) and angular velocity (3) of a link."""
    pose = link.entity_pose
    return (*pose.p, *pose.q, *link.linear_velocity, *link.angular_velocity)


def wanted(spec: SceneSpec) -> bool:
    """Return whether `State` has a contact quantity that can ever be anything but zero in this scene."""
    robot = spec.robot
    if robot is None or not can_collide(spec, robot, ignored_bits(robot)):
        return False
    return bool(robot.touch_sensors) or spec.num_bodies > 0
