"""Names in a side file: checked against the robot file, and moved along when links are merged."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from guard_api import rotations
from guard_api.model.base import BASE_KINDS, WORLD
from guard_api.model.inertia import as_vector
from guard_api.model.merge import Merged, compose
from guard_api.model.problems import Problems, did_you_mean
from guard_api.model.robot import PLANAR_JOINTS, Actuator, Frame, Segment, Sensor
from guard_api.model.sidefile import DEFAULT, SideFile
from guard_api.model.tree import Tree
from guard_api.shapes import Pose


def check_references(tree: Tree, side: SideFile, problems: Problems) -> None:
    """Report every link and joint that `side` names and `tree` has not; a fixed joint is none that moves."""
    based = {joint.kind for joint in tree.joints if joint.kind in BASE_KINDS and joint.parent == WORLD}
    links = [link.name for link in tree.links if not (based and link.name == WORLD)]
    joints = [joint.name for joint in tree.joints if joint.kind not in {"fixed", *BASE_KINDS}]
    fixed = {joint.name for joint in tree.joints if joint.kind == "fixed"}
    planar = side.base == "planar" or "planar" in based
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
        check(f"sensors[{i}].joint", "joint", [sensor.joint], driven)
    for i, segment in enumerate(side.segments):
        check(f"segments[{i}].start", "link", [segment.start.link], links)
        check(f"segments[{i}].end", "link", [segment.end.link], links)
    check("reference", "link", [side.reference.link] if side.reference else [], links)
    lidar = [frame.link for frame in side.lidar]
    check("lidar", "link", lidar, links)
    for name in dict.fromkeys(name for name in lidar if lidar.count(name) > 1):
        problems.error(f"{side.place}: lidar", f"link {name!r} is named twice: name it once")
    check("home.joints", "joint", side.joint_position, joints)
    for key, values in _by_joint(side).items():
        check(key, "joint", values, [*joints, DEFAULT])
    check("friction", "link or collision", side.friction, [*links, *shapes, DEFAULT])


def place_actuators(actuators: Iterable[Actuator], merged: Merged) -> tuple[Actuator, ...]:
    """Return the actuators with thrust points and directions in the axes of the bodies that carry them."""
    return tuple(_placed(actuator, merged) for actuator in actuators)


def place_sensors(side: SideFile, merged: Merged, problems: Problems) -> tuple[Sensor, ...]:
    """Return the sensors with poses in the axes of the bodies that carry them.

    Two sensors of the touch on all of one body and a rotation relative to nothing that moves are reported.
    """
    placed: list[Sensor] = []
    felt: dict[str, str] = {}
    for i, sensor in enumerate(side.sensors):
        if sensor.link not in merged.where:
            placed.append(sensor)
            continue
        body, pose = merged.where[sensor.link]
        place = f"{side.place}: sensors[{i}].link"
        match sensor.kind:
            case "touch":
                _check_touch(sensor, body, felt, place, problems)
                position = compose(pose, sensor.pose).position
                placed.append(replace(sensor, link=body, pose=Pose(position=position)))
            case "relative_rotation" | "relative_angular_velocity":
                _check_relative(sensor, merged, place, problems)
                placed.append(sensor)
            case _:
                placed.append(replace(sensor, link=body, pose=compose(pose, sensor.pose)))
    return tuple(placed)


def place_frame(frame: Frame, merged: Merged) -> Frame:
    """Return the frame in the axes of the body that carries it, under its own name."""
    if frame.link not in merged.where:
        return frame
    body, pose = merged.where[frame.link]
    return replace(frame, link=body, pose=compose(pose, frame.pose))


def place_segments(segments: Iterable[Segment], merged: Merged) -> tuple[Segment, ...]:
    """Return the segments with both frames in the axes of the bodies that carry them."""
    return tuple(
        replace(segment, start=place_frame(segment.start, merged), end=place_frame(segment.end, merged))
        for segment in segments
    )


def _by_joint(side: SideFile) -> dict[str, dict[str, float]]:
    return {
        "armature": side.armature,
        "damping": side.damping,
        "stiffness": side.stiffness,
        "rest_position": side.rest_position,
    }


def _check_touch(sensor: Sensor, body: str, felt: dict[str, str], place: str, problems: Problems) -> None:
    """Report a second sensor on all of `body`; `felt`: body -> link of the first."""
    if sensor.radius < math.inf:
        return
    link = str(sensor.link)
    if body in felt:
        problems.error(
            place,
            f"touch on links {felt[body]!r} and {link!r}: they are one rigid body {body!r}: remove a sensor, or "
            "tell them apart by position and radius",
        )
    elif link != body:
        problems.note(f"sensor {sensor.name!r} feels touch on all of {body!r}, which link {link!r} is merged into")
    felt.setdefault(body, link)


def _check_relative(sensor: Sensor, merged: Merged, place: str, problems: Problems) -> None:
    """Report a rotation of a link that does not turn against the one before it."""
    body, _ = merged.where[str(sensor.link)]
    if body != sensor.link:
        problems.error(place, f"link {sensor.link!r} is fixed to {body!r}: name a link that hangs on a moving joint")
    elif body == merged.bodies[0].name:
        problems.error(place, f"link {body!r} is the root: no link before it, against which it could turn")


def _placed(actuator: Actuator, merged: Merged) -> Actuator:
    if actuator.link not in merged.where:
        return actuator
    body, pose = merged.where[actuator.link]
    point = np.asarray(pose.position) + rotations.rotate(pose.quaternion, actuator.point)
    direction = rotations.rotate(pose.quaternion, actuator.direction)
    return replace(actuator, link=body, point=as_vector(point), direction=as_vector(direction))
