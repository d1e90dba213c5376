"""Sensors: those of the neutral model, under MJCF's names for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from guard_api.model.element import Element
from guard_api.model.mjcf.attributes import numbers
from guard_api.model.mjcf.bodies import Bodies
from guard_api.model.mjcf.document import Document
from guard_api.model.problems import did_you_mean
from guard_api.model.robot import Sensor, SensorKind
from guard_api.shapes import Pose

KINDS: dict[str, SensorKind] = {
    "accelerometer": "accelerometer",
    "velocimeter": "velocimeter",
    "gyro": "gyro",
    "magnetometer": "magnetometer",
    "touch": "touch",
    "jointpos": "joint_position",
    "jointvel": "joint_velocity",
    "ballquat": "relative_rotation",
    "ballangvel": "relative_angular_velocity",
}

SITE_RADIUS = 0.005
"""Radius [m] of a site that states no size."""


def read_sensors(root: Element, bodies: Bodies, document: Document, stated: Mapping[str, Sensor]) -> Iterator[Sensor]:
    """Yield the sensors of the file in order, those that the side file has `stated` by name in its words.

    Kinds that the neutral model does not have are left to the vocabulary's notes.
    """
    places: dict[str, int] = {}
    for section in root.children("sensor"):
        for node in section.children():
            if node.tag not in KINDS:
                continue
            where = node.attributes.get("site") or node.attributes.get("joint", "")
            name = node.attributes.get("name") or f"{node.tag}_{where}"
            if name in places:
                node.error(f"sensor name {name!r} is taken already (line {places[name]}): rename one")
            places[name] = node.line
            if name in stated:
                yield stated[name]
                continue
            if node.number("cutoff", 0.0) != 0.0:
                node.error(f"sensor {name!r}: cutoff is not supported: remove it")
            sensor = (_on_joint if "joint" in node.attributes else _on_site)(node, name, bodies)
            if sensor:
                yield sensor


def _on_joint(node: Element, name: str, bodies: Bodies) -> Sensor | None:
    written = node.attributes["joint"]
    kind = KINDS[node.tag]
    of_ball = kind in {"relative_rotation", "relative_angular_velocity"}
    known = [key for key, moved in bodies.moved.items() if (moved.joint.kind == "ball") == of_ball]
    if written not in known:
        which = "ball joint" if of_ball else "hinge or slide"
        node.error(f"sensor {name!r}: there is no {which} {written!r}: {did_you_mean(written, known)}")
        return None
    moved = bodies.moved[written]
    if of_ball:
        return Sensor(name=name, kind=kind, link=moved.body)
    return Sensor(name=name, kind=kind, joint=moved.name)


def _on_site(node: Element, name: str, bodies: Bodies) -> Sensor | None:
    written = node.text("site")
    site = bodies.sites.get(written)
    if site is None:
        if written:
            node.error(
                f"sensor {name!r}: site {written!r} does not exist on the robot: {did_you_mean(written, bodies.sites)}"
            )
        return None
    if node.tag != "touch":
        return Sensor(name=name, kind=KINDS[node.tag], link=site.link, pose=site.pose)
    if site.node.attributes.get("type", "sphere") != "sphere":
        site.node.error(f"sensor {name!r} feels within a site that is no sphere: make it one")
    radius = numbers(site.node, "size", 1, 3, (SITE_RADIUS,))[0]
    return Sensor(name=name, kind="touch", link=site.link, pose=Pose(position=site.pose.position), radius=radius)
