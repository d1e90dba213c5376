"""Names in a side file: checked against the robot file, and moved along when links are merged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from guard_api import rotations
from guard_api.model.base import WORLD
from guard_api.model.inertia import as_vector
from guard_api.model.merge import Merged, compose
from guard_api.model.problems import Problems, did_you_mean
from guard_api.model.robot import PLANAR_JOINTS, Actuator, Sensor
from guard_api.model.sidefile import DEFAULT, SideFile
from guard_api.model.tree import Tree


def check_references(tree: Tree, side: SideFile, problems: Problems) -> None:
    """Report every link and joint that `side` names and `tree` has not; a fixed joint is none that moves."""
    links = [link.name for link in tree.links]
    joints = [joint.name for joint in tree.joints if joint.kind not in {"fixed", "planar", "floating"}]
    fixed = {joint.name for joint in tree.joints if joint.kind == "fixed"}
    planar = side.base == "planar" or any(joint.kind == "planar" and joint.parent == WORLD for joint in tree.joints)
    driven = [*PLANAR_JOINTS, *joints] if planar else joints
    shapes = [shape.name for link in tree.links for shape in link.collisions if shape.name]

    def check(key: str, kind: str, names: Iterable[str | None], known: list[str]) -> None:
        for name in names:
            if name and name not in known:
                why = "is fixed" if kind == "joint" and name in fixed else "does not exist"
                problems.error(f"{side.place}: {key}", f"{kind} {name!r} {why}: {did_you_mean(name, known)}")

    for i, actuator in enumerate(side.actuators):
        check(f"actuators[{i}].joint", "joint", [actuator.joint], driven)
        check(f"actuators[{i}].link", "link", [actuator.link], links)
    for i, sensor in enumerate(side.sensors):
        check(f"sensors[{i}].link", "link", [sensor.link], links)
    check("touch", "link", side.touch, links)
    check("home.joints", "joint", side.joint_position, joints)
    check("armature", "joint", side.armature, [*joints, DEFAULT])
    check("friction", "link or collision", side.friction, [*links, *shapes, DEFAULT])


def place_actuators(actuators: Iterable[Actuator], merged: Merged) -> tuple[Actuator, ...]:
    """Return the actuators with thrust points and directions in the axes of the bodies that carry them."""
    return tuple(_placed(actuator, merged) for actuator in actuators)


def place_sensors(sensors: Iterable[Sensor], merged: Merged) -> tuple[Sensor, ...]:
    """Return the sensors with poses in the axes of the bodies that carry them."""
    placed = []
    for sensor in sensors:
        body, pose = merged.where.get(sensor.link, (sensor.link, None))
        placed.append(replace(sensor, link=body, pose=compose(pose, sensor.pose)) if pose else sensor)
    return tuple(placed)


def place_touch_links(side: SideFile, merged: Merged, problems: Problems) -> tuple[str, ...]:
    """Return the bodies that carry the touch links; two links of one body cannot be told apart and are reported."""
    bodies: dict[str, str] = {}
    for link in side.touch:
        body = merged.where[link][0] if link in merged.where else link
        if body in bodies:
            problems.error(
                f"{side.place}: touch",
                f"links {bodies[body]!r} and {link!r} are one rigid body {body!r}: name one of them",
            )
        bodies[body] = link
    return tuple(bodies)


def _placed(actuator: Actuator, merged: Merged) -> Actuator:
    if actuator.link not in merged.where:
        return actuator
    body, pose = merged.where[actuator.link]
    point = np.asarray(pose.position) + rotations.rotate(pose.quaternion, actuator.point)
    direction = rotations.rotate(pose.quaternion, actuator.direction)
    return replace(actuator, link=body, point=as_vector(point), direction=as_vector(direction))
