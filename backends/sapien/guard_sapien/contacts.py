"""Who touches the robot, and how hard: PhysX's contact list after each substep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api.scene.spec import SceneSpec
from guard_sapien.articulation import can_collide, ignored_bits
from guard_sapien.compile import Copy
from guard_sapien.engine import physx


class ContactReader:
    """Adds up touch impulses (K,) [N s] and body contacts (B,) of one world, substep by substep."""

    def __init__(self, spec: SceneSpec, copy: Copy) -> None:
        assert spec.robot is not None and copy.robot is not None
        column = {name: k for k, name in enumerate(spec.robot.touch_links)}
        self._get_contacts = copy.system.get_contacts
        # PhysX hands out the same Python object for the same body every time.
        self._touch: dict[physx.PhysxRigidBaseComponent, int | None] = {
            component: column.get(link.name) for component, link in zip(copy.robot.links, spec.robot.links, strict=True)
        }
        self._body: dict[physx.PhysxRigidBaseComponent, int] = {
            component: index for index, component in enumerate(copy.bodies)
        }

    def add(self, impulse: NDArray[np.float64], touched: NDArray[np.bool_]) -> None:
        """Add the contacts of the last substep to one world's `impulse` (K,) and `touched` (B,)."""
        for contact in self._get_contacts():
            first, second = contact.bodies
            if (first in self._touch) == (second in self._touch):
                continue  # the robot with itself, or without the robot
            link, other = (first, second) if first in self._touch else (second, first)
            column, index = self._touch[link], self._body.get(other)
            if column is None and (index is None or touched[index]):
                continue
            points = contact.points
            # PhysX reports the normal part of the impulse only.
            pressed = [float(np.linalg.norm(point.impulse)) for point in points]
            if column is not None:
                impulse[column] += sum(pressed)
            if index is not None and not touched[index]:
                touched[index] = any(p > 0 or point.separation <= 0 for p, point in zip(pressed, points, strict=True))


def wanted(spec: SceneSpec) -> bool:
    """Return whether `State` has a contact quantity that can ever be anything but zero in this scene."""
    robot = spec.robot
    if robot is None or not can_collide(spec, robot, ignored_bits(robot)):
        return False
    return bool(robot.touch_links) or spec.num_bodies > 0
