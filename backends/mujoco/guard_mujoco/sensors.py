"""Contact over a whole step: touch forces and which bodies the robot touched, through MuJoCo's sensors.

Sensors are the only way to see contacts in a batch; their values are recorded at every substep.
"""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.model.robot import RobotModel
from guard_api.scene.spec import SceneSpec
from guard_mujoco.contact import Role, Surface
from guard_mujoco.robot import link_body, neighbours

OWN_CONTACTS = 4
"""Strongest contacts of a touch link with other links of the robot that are taken out of its touch force."""

EVERYWHERE = 1e4
"""Radius [m] about the link inside which a contact counts as touching it."""

ROUNDING = 1e-9
"""Share of a touch force below which it is the rounding of its parts."""

BODY_ROLES: frozenset[Role] = frozenset({"static", "driven", "dynamic"})

_FOUND = 1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND)
_FORCE = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
_UNSORTED, _STRONGEST = 0, 2

NONE = np.empty(0, np.intp)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactReadout:
    """Columns of the sensor data.

    num_touch: number K of touch links; they have no sensors in a scene where nothing can touch them.
    touch: all normal force on each touch link. own: for the c-th strongest contact of a link with the robot itself,
    the columns of the normal force, (OWN_CONTACTS, k), on the touch links number own_link (k,).
    found: number of contacts of the robot with each of the B bodies.
    """

    num_touch: int
    touch: slice
    own: NDArray[np.intp]
    own_link: NDArray[np.intp]
    found: slice

    @property
    def any(self) -> bool:
        """Whether there is anything to record."""
        return self.found.stop > 0

    def read(self, recorded: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return touch (n, K) [N], the mean over substeps, and body_contact (n, B), from recorded (n, substeps, S)."""
        substeps = recorded.shape[1]
        total = recorded[:, 0].copy()
        for k in range(1, substeps):  # in this order for any number of worlds, which numpy's own sum does not promise
            total += recorded[:, k]
        touch = total[:, self.touch].copy()
        if len(self.own_link):
            for columns in self.own:
                touch[:, self.own_link] -= total[:, columns]
            # What is left of a force that was all the robot's own is the rounding of two sums.
            touch[touch < ROUNDING * total[:, self.touch]] = 0.0
        return touch / substeps, total[:, self.found] > 0.0


def add_contact_sensors(spec: mujoco.MjSpec, scene: SceneSpec, surfaces: list[Surface]) -> None:
    """Add, in this order: K touch sensors, the robot's contacts with itself, B sensors of contact with bodies."""
    robot = scene.robot
    roles = {surface.role for surface in surfaces}
    if robot is None or not (roles & BODY_ROLES or {"ground", "robot"} <= roles):
        return  # nothing but itself that the robot could touch
    for name in robot.touch_links:
        _add_touch(spec, robot, name)
    root = link_body(robot.links[0].name)
    for name in _self_touching(robot):
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            intprm=[_FORCE, _STRONGEST, OWN_CONTACTS],
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            objname=link_body(name),
            reftype=mujoco.mjtObj.mjOBJ_XBODY,
            refname=root,
        )
    for surface in surfaces:
        if surface.role in BODY_ROLES:
            spec.add_sensor(
                type=mujoco.mjtSensor.mjSENS_CONTACT,
                intprm=[_FOUND, _UNSORTED, 1],
                objtype=mujoco.mjtObj.mjOBJ_XBODY,
                objname=root,
                reftype=mujoco.mjtObj.mjOBJ_GEOM,
                refname=surface.geom,
            )


def contact_readout(scene: SceneSpec, model: mujoco.MjModel) -> ContactReadout:
    """Return where the sensors of `add_contact_sensors` write."""
    robot = scene.robot
    if robot is None or model.nsensordata == 0:
        nothing = slice(0, 0)
        num_touch = len(robot.touch_links) if robot else 0
        return ContactReadout(num_touch=num_touch, touch=nothing, own=NONE, own_link=NONE, found=nothing)
    num_touch, own_links = len(robot.touch_links), _self_touching(robot)
    first = num_touch + OWN_CONTACTS * 3 * np.arange(len(own_links))
    return ContactReadout(
        num_touch=num_touch,
        touch=slice(0, num_touch),
        # Three numbers per contact, normal force first.
        own=first + 3 * np.arange(OWN_CONTACTS)[:, None],
        own_link=np.array([robot.touch_links.index(name) for name in own_links], np.intp),
        found=slice(model.nsensordata - scene.num_bodies, model.nsensordata),
    )


def touch_approximations(robot: RobotModel) -> list[str]:
    """Return what the touch sensors of `robot` cannot say exactly."""
    if not _self_touching(robot):
        return []
    return [
        f"touch: of a link's simultaneous contacts with the robot itself, the {OWN_CONTACTS} strongest are taken out"
    ]


def _add_touch(spec: mujoco.MjSpec, robot: RobotModel, link: str) -> None:
    if robot.links[robot.link_index(link)].virtual:
        raise BackendError(f"touch link {link!r} has no mass: MuJoCo has no body for it")
    site = spec.body(link_body(link)).add_site(name=f"touch/{link}", size=[EVERYWHERE] * 3)
    spec.add_sensor(type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site.name)


def _self_touching(robot: RobotModel) -> list[str]:
    """Return the touch links that can touch another link of the robot: one with collisions that is no neighbour."""
    solid = [link.name for link in robot.links if link.collisions]
    joined = neighbours(robot)
    return [
        name
        for name in robot.touch_links
        if name in solid and any(o != name and frozenset((link_body(name), link_body(o))) not in joined for o in solid)
    ]
