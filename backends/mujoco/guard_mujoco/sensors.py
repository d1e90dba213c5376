"""Contact over a whole step: touch forces and which bodies the robot touched, through MuJoCo's sensors.

Sensors are the only way to see contacts in a batch. The engine keeps the last values of each in a ring, one for every
substep of an environment step, so that nothing has to be fetched in between.
"""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.model.robot import RobotModel, Sensor
from guard_api.physics.touch import TouchSensors, counts
from guard_api.scene.spec import SceneSpec
from guard_mujoco.contact import Role, Surface
from guard_mujoco.history import Columns, Window, columns_of, sum_in_order
from guard_mujoco.robot import link_body, neighbours

Array = NDArray[np.float64]

OWN_CONTACTS = 4
"""Strongest contacts of a link with other links of the robot that are taken out of what its touch sensors read."""

EVERYWHERE = 1e4
"""Radius [m] of a touch sensor without one: every contact of the link is inside it."""

ROUNDING = 1e-9
"""Share of a touch force below which it is the rounding of its parts."""

BODY_ROLES: frozenset[Role] = frozenset({"static", "driven", "dynamic"})

_FOUND = 1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND)
# What is recorded of a contact with the robot itself: 3 numbers each, the normal force first.
_FORCE, _POINT, _NORMAL = (
    1 << int(item)
    for item in (
        mujoco.mjtConDataField.mjCONDATA_FORCE,
        mujoco.mjtConDataField.mjCONDATA_POS,
        mujoco.mjtConDataField.mjCONDATA_NORMAL,
    )
)
_UNSORTED, _STRONGEST = 0, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnContacts:
    """The strongest contacts of a touch sensor's link with the robot itself; C = `OWN_CONTACTS`.

    sensor: number k of the touch sensor. radius: [m]. force: columns of C normal forces [N], the strongest first.
    point, normal: columns of C points [m] and normals out of the link. place: columns of where the sensor is [m]. These
    three are None for a sensor that counts every contact.
    """

    sensor: int
    radius: float
    force: Columns
    point: Columns | None = None
    normal: Columns | None = None
    place: Columns | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactReadout:
    """Where contact is found in the engine's rings of sensor values.

    num_touch: number K of touch sensors; they do not exist in the engine where nothing can touch the robot.
    num_bodies: number B of bodies. samples: substeps that the rings hold; 0 without sensors. summed: columns of all
    normal force on each touch sensor, of the number of contacts with each body, and of the largest force by which each
    link concerned touches the robot itself, which is nearly always 0. own: what is known of those contacts.
    """

    num_touch: int
    num_bodies: int
    samples: int
    summed: Columns
    own: tuple[OwnContacts, ...]

    @property
    def any(self) -> bool:
        """Whether there is anything to read."""
        return self.samples > 0

    def portions(self, substeps: int) -> Iterator[int]:
        """Yield numbers of substeps, `substeps` in all, none more than the rings hold."""
        while substeps > 0:
            portion = min(substeps, self.samples)
            yield portion
            substeps -= portion

    def read(self, history: Array, substeps: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return touch (n, K) [N], summed, and body_contact (n, B) of the last `substeps` in `history` (n, H)."""
        window = Window(history, substeps, self.samples)
        sums = window.sum(self.summed)
        touch, found = sums[:, : self.num_touch], sums[:, self.num_touch : self.num_touch + self.num_bodies] > 0.0
        strongest = sums[:, self.num_touch + self.num_bodies :]
        for number in np.flatnonzero(strongest.any(axis=0)) if strongest.any() else ():
            own, worlds = self.own[number], np.flatnonzero(strongest[:, number])
            every = touch[worlds, own.sensor]
            others = every - _counted(Window(history[worlds], substeps, self.samples), own)
            # What is left of a force that was all the robot's own is the rounding of two sums.
            touch[worlds, own.sensor] = np.where(others < ROUNDING * every, 0.0, others)
        return touch, found


def add_contact_sensors(spec: mujoco.MjSpec, scene: SceneSpec, surfaces: list[Surface]) -> None:
    """Add K touch sensors, sensors of the robot's contacts with itself and of where they matter, and B of bodies."""
    robot = scene.robot
    roles = {surface.role for surface in surfaces}
    if robot is None or not (roles & BODY_ROLES or {"ground", "robot"} <= roles):
        return  # nothing but itself that the robot could touch
    touch = robot.touch_sensors
    rule = TouchSensors(robot)
    for number, sensor in enumerate(touch):
        _add_touch(spec, robot, number, sensor)
    root = link_body(robot.links[0].name)
    for link in _self_touching(robot):
        located = robot.link_index(link) in rule.located
        spec.add_sensor(
            name=f"own/{link}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            intprm=[_FORCE | _POINT | _NORMAL if located else _FORCE, _STRONGEST, OWN_CONTACTS],
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            objname=link_body(link),
            reftype=mujoco.mjtObj.mjOBJ_XBODY,
            refname=root,
        )
        for number in (k for k, sensor in enumerate(touch) if sensor.link == link and rule.limited[k]):
            spec.add_sensor(
                name=f"place/{number}",
                type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=f"touch/{number}",
            )
    bodies = [surface for surface in surfaces if surface.role in BODY_ROLES]
    for number, surface in enumerate(bodies):
        spec.add_sensor(
            name=f"found/{number}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            intprm=[_FOUND, _UNSORTED, 1],
            objtype=mujoco.mjtObj.mjOBJ_XBODY,
            objname=root,
            reftype=mujoco.mjtObj.mjOBJ_GEOM,
            refname=surface.geom,
        )
    for sensor in spec.sensors:
        sensor.nsample = robot.substeps


def contact_readout(scene: SceneSpec, model: mujoco.MjModel) -> ContactReadout:
    """Return where the sensors of `add_contact_sensors` leave their values."""
    robot = scene.robot
    touch = robot.touch_sensors if robot else ()
    if robot is None or model.nsensor == 0:
        none = columns_of(model, [])
        return ContactReadout(num_touch=len(touch), num_bodies=scene.num_bodies, samples=0, summed=none, own=())
    limited, self_touching = TouchSensors(robot).limited, _self_touching(robot)
    own = tuple(
        _own_contacts(model, number, sensor, limited=limited[number])
        for number, sensor in enumerate(touch)
        if sensor.link in self_touching
    )
    names = [*(f"touch/{k}" for k in range(len(touch))), *(f"found/{k}" for k in range(scene.num_bodies))]
    first = columns_of(model, [model.sensor(name).id for name in names])
    return ContactReadout(
        num_touch=len(touch),
        num_bodies=scene.num_bodies,
        samples=robot.substeps,
        summed=Columns.joined([first, *(item.force.part(np.array([0])) for item in own)]),
        own=own,
    )


def touch_approximations(robot: RobotModel) -> list[str]:
    """Return what the touch sensors of `robot` cannot say exactly."""
    if not _self_touching(robot):
        return []
    return [
        f"touch: of a link's simultaneous contacts with the robot itself, the {OWN_CONTACTS} strongest are taken out"
    ]


def _add_touch(spec: mujoco.MjSpec, robot: RobotModel, number: int, sensor: Sensor) -> None:
    link = str(sensor.link)
    if robot.links[robot.link_index(link)].virtual:
        raise BackendError(f"touch sensor {sensor.name!r}: link {link!r} has no mass, MuJoCo has no body for it")
    radius = sensor.radius if np.isfinite(sensor.radius) else EVERYWHERE
    site = spec.body(link_body(link)).add_site(
        name=f"touch/{number}", size=[radius] * 3, pos=list(sensor.pose.position)
    )
    spec.add_sensor(
        name=site.name, type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site.name
    )


def _own_contacts(model: mujoco.MjModel, number: int, sensor: Sensor, *, limited: bool) -> OwnContacts:
    """Return where to find the contacts of sensor number `number` with the robot itself."""
    every = columns_of(model, [model.sensor(f"own/{sensor.link}").id])
    numbers = np.arange(len(every)).reshape(OWN_CONTACTS, -1, 3)  # force, and perhaps point and normal
    own = OwnContacts(sensor=number, radius=sensor.radius, force=every.part(numbers[:, 0, 0]))
    if not limited:
        return own
    return replace(
        own,
        point=every.part(numbers[:, 1].ravel()),
        normal=every.part(numbers[:, 2].ravel()),
        place=columns_of(model, [model.sensor(f"place/{number}").id]),
    )


def _counted(window: Window, own: OwnContacts) -> Array:
    """Return the sum of the forces by which the robot touches a sensor of its own: (n,) [N]."""
    force = window.read(own.force)
    if own.point and own.normal and own.place:
        triples = (*force.shape, 3)
        point, normal = window.read(own.point).reshape(triples), window.read(own.normal).reshape(triples)
        place = window.read(own.place)[:, :, None]
        force = np.where(counts(point, normal, place, own.radius), force, 0.0)
    return sum_in_order(sum_in_order(force))


def _self_touching(robot: RobotModel) -> list[str]:
    """Return the links with touch sensors that can touch another link of the robot: those that are no neighbours."""
    solid = [link.name for link in robot.links if link.collisions]
    joined = neighbours(robot)
    sensed = dict.fromkeys(str(sensor.link) for sensor in robot.touch_sensors)
    return [
        name
        for name in sensed
        if name in solid and any(o != name and frozenset((link_body(name), link_body(o))) not in joined for o in solid)
    ]
