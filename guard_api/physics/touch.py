"""What a touch sensor reads: one rule for the contacts of every engine.

Of the contacts between its link and anything that is not the robot, a sensor counts those whose ray, from the contact
point along the normal *out of the link*, comes within the sensor's radius of its place. So a contact inside the sphere
always counts, and one that lies so deep in the link that it has left the sphere at the back still does. The reading is
the sum of the counted normal forces, averaged over the substeps of the last step.

Source: the rule of MuJoCo's touch sensor; that counts contacts with the robot itself too, and only the last substep's.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import Collision, Link, RobotModel, Sensor
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Sphere, Vector3

Array = NDArray[np.float64]

SPARE: Final = 1.05
"""A sphere this many times as large as it takes to hold a link's shapes holds the points of its contacts too, which
lie in the shapes or a hair off them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkContacts:
    """M contact points between links of the robot and what is not the robot, of any worlds and substeps.

    world, link: (M,) which ones. force: (M,) [N] along the normal. point: (M, 3) [m], normal: (M, 3), unit, out of the
    link. position (M, 3) [m], quaternion (M, 4): of the link's frame when the contact was found; they count for the
    links in `TouchSensors.located` only. All in world axes.
    """

    world: NDArray[np.intp]
    link: NDArray[np.intp]
    force: Array
    point: Array
    normal: Array
    position: Array
    quaternion: Array


class TouchSensors:
    """The K touch sensors of a robot (or of none), in the order of `State.touch`; pure, it holds no state.

    links: indices of the links that have any. limited: (K,) whether a sensor may leave contacts of its link out.
    located: the links that have such a sensor.
    """

    def __init__(self, robot: RobotModel | None) -> None:
        self._sensors = robot.touch_sensors if robot else ()
        self._links = [robot.link_index(str(sensor.link)) for sensor in self._sensors] if robot else []
        self.links = frozenset(self._links)
        pairs = list(zip(self._sensors, self._links, strict=True))
        self.limited = tuple(not _covers(sensor, robot.links[link]) for sensor, link in pairs) if robot else ()
        self.located = frozenset(link for link, limited in zip(self._links, self.limited, strict=True) if limited)

    def __len__(self) -> int:
        """Return the number of sensors K."""
        return len(self._sensors)

    def force(self, contacts: LinkContacts, num_worlds: int) -> Array:
        """Return the sum over all contacts that each sensor counts: (N, K) [N]."""
        total = np.zeros((num_worlds, len(self)))
        for column, (sensor, link) in enumerate(zip(self._sensors, self._links, strict=True)):
            rows = np.flatnonzero(contacts.link == link)
            if self.limited[column]:
                arm = rotations.rotate(contacts.quaternion[rows], sensor.pose.position)
                place = contacts.position[rows] + arm
                rows = rows[counts(contacts.point[rows], contacts.normal[rows], place, sensor.radius)]
            # Added one after another, so that a world's sum has the same bits whatever the other worlds feel.
            total[:, column] = np.bincount(contacts.world[rows], contacts.force[rows], num_worlds)
        return total


def counts(point: Array, normal: Array, place: Array, radius: float) -> NDArray[np.bool_]:
    """Return whether the ray from `point` (..., 3) along the unit `normal` (..., 3) meets the ball about `place`."""
    offset = place - point
    ahead = np.maximum((offset * normal).sum(axis=-1), 0.0)
    gap = offset - ahead[..., None] * normal
    return (gap * gap).sum(axis=-1) <= radius * radius


def _covers(sensor: Sensor, link: Link) -> bool:
    """Return whether every contact of `link` is well inside the sensor's sphere, so that nobody needs to look."""
    reach = max((_reach(collision, sensor.pose.position) for collision in link.collisions), default=0.0)
    return sensor.radius >= SPARE * reach


def _reach(collision: Collision, place: Vector3) -> float:
    """Return how far the farthest point of a shape is at most from `place` in the link's axes [m]."""
    match collision.shape:
        case Sphere(radius=radius):
            points, thickness = np.zeros((1, 3)), radius
        case Capsule(radius=radius, half_length=half) | Cylinder(radius=radius, half_length=half):
            points, thickness = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), radius
        case Box(half_extents=half):
            points, thickness = np.array(list(product(*((-x, x) for x in half)))), 0.0
        case Mesh(vertices=vertices):
            points, thickness = np.array(vertices), 0.0
    points = np.add(collision.pose.position, rotations.rotate(collision.pose.quaternion, points))
    return float(np.linalg.norm(points - place, axis=1).max()) + thickness
