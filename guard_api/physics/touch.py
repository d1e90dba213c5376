"""What a touch sensor reads: one rule for the contacts of every engine.

Of the contacts between its link and anything that is not the robot, a sensor counts those whose ray, from the contact
point along the normal *out of the link*, comes within the sensor's radius of its place. So a contact inside the sphere
always counts, and one that lies so deep in the link that it has left the sphere at the back still does. The reading is
the sum of the counted normal forces, averaged over the substeps of the last step.

Source: the rule of MuJoCo's touch sensor; that counts contacts with the robot itself too, and only the last substep's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkContacts:
    """M contact points between links of the robot and what is not the robot, of any worlds and substeps.

    world, link: (M,) which ones. force: (M,) [N] along the normal. point: (M, 3) [m], normal: (M, 3), unit, out of the
    link. position (M, 3) [m], quaternion (M, 4): of the link's frame, `age` [s] after the contact was found.
    com_velocity (M, 3) [m/s] of the link's centre of mass, angular_velocity (M, 3) [rad/s]: at the same time. All in
    world axes. Frames and velocities count for the links in `TouchSensors.located` only.
    """

    world: NDArray[np.intp]
    link: NDArray[np.intp]
    force: Array
    point: Array
    normal: Array
    position: Array
    quaternion: Array
    com_velocity: Array
    angular_velocity: Array
    age: float = 0.0


class TouchSensors:
    """The K touch sensors of a robot (or of none), in the order of `State.touch`; pure, it holds no state.

    links: indices of the links that have any. located: those of them where the place of a contact matters.
    """

    def __init__(self, robot: RobotModel | None) -> None:
        self._sensors = robot.touch_sensors if robot else ()
        self._links = [robot.link_index(str(sensor.link)) for sensor in self._sensors] if robot else []
        self._coms = [robot.links[link].com for link in self._links] if robot else []
        self.links = frozenset(self._links)
        finite = [bool(np.isfinite(sensor.radius)) for sensor in self._sensors]
        self.located = frozenset(link for link, limited in zip(self._links, finite, strict=True) if limited)

    def __len__(self) -> int:
        """Return the number of sensors K."""
        return len(self._sensors)

    def force(self, contacts: LinkContacts, num_worlds: int) -> Array:
        """Return the sum over all contacts that each sensor counts: (N, K) [N]."""
        total = np.zeros((num_worlds, len(self)))
        for column, (sensor, link) in enumerate(zip(self._sensors, self._links, strict=True)):
            rows = np.flatnonzero(contacts.link == link)
            if link in self.located:
                place = self._place(contacts, rows, column)
                rows = rows[counts(contacts.point[rows], contacts.normal[rows], place, sensor.radius)]
            # Added one after another, so that a world's sum has the same bits whatever the other worlds feel.
            total[:, column] = np.bincount(contacts.world[rows], contacts.force[rows], num_worlds)
        return total

    def _place(self, contacts: LinkContacts, rows: NDArray[np.intp], column: int) -> Array:
        """Return where the sensor was when the contacts `rows` were found: (M', 3) [m]."""
        offset, com = np.array(self._sensors[column].pose.position), np.array(self._coms[column])
        quaternion = contacts.quaternion[rows]
        turn = rotations.cross(contacts.angular_velocity[rows], rotations.rotate(quaternion, offset - com))
        way = contacts.age * (contacts.com_velocity[rows] + turn)
        return contacts.position[rows] + rotations.rotate(quaternion, offset) - way


def counts(point: Array, normal: Array, place: Array, radius: float) -> NDArray[np.bool_]:
    """Return whether the ray from `point` (..., 3) along the unit `normal` (..., 3) meets the ball about `place`."""
    offset = place - point
    ahead = np.maximum((offset * normal).sum(axis=-1), 0.0)
    gap = offset - ahead[..., None] * normal
    return (gap * gap).sum(axis=-1) <= radius * radius
