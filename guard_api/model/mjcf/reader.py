"""Reads MJCF into a `Tree` and the statements of a side file, which `robot.toml` completes or overrides.

Strict about what it uses, with every fault of a file reported at its line. What the neutral model has no place for is
listed in the notes, once per kind; what would make another robot if it were left out is an error.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from guard_api.model.element import parse
from guard_api.model.mjcf.actuators import read_actuators
from guard_api.model.mjcf.bodies import Bodies, read_bodies
from guard_api.model.mjcf.compiler import read_timestep
from guard_api.model.mjcf.document import read_document
from guard_api.model.mjcf.sensors import read_sensors
from guard_api.model.mjcf.vocabulary import check_words
from guard_api.model.problems import Problems
from guard_api.model.sidefile import SideFile
from guard_api.model.tree import Tree


def read_mjcf(path: Path, side: SideFile, problems: Problems) -> tuple[Tree | None, SideFile]:
    """Return the tree of the MJCF file at `path`, and `side` completed by what the file states besides.

    An actuator or sensor of `side` stands in the place of the file's of that name, or else follows all of the file's.
    The tree is None when nothing can be read. Faults go to `problems`; where there are any, both hold stand-ins.
    """
    root = parse(path, problems)
    if root is None:
        return None, side
    if root.tag != "mujoco":
        root.error(f"the outermost element is <{root.tag}>: MJCF begins with <mujoco>; a URDF is called .urdf")
        return None, side
    check_words(root, problems)
    document = read_document(root)
    bodies = read_bodies(root, document, side.base)
    own_actuators = {actuator.name: actuator for actuator in side.actuators}
    own_sensors = {sensor.name: sensor for sensor in side.sensors}
    actuators = {each.name: each for each in read_actuators(root, bodies, document, own_actuators)}
    sensors = {each.name: each for each in read_sensors(root, bodies, document, own_sensors)}
    timestep = read_timestep(root)
    side = replace(
        _standing(side, bodies),
        timestep=side.timestep if timestep is None or "timestep" in side.given else timestep,
        joint_position=bodies.start | side.joint_position,
        actuators=tuple((actuators | own_actuators).values()),
        sensors=tuple((sensors | own_sensors).values()),
    )
    document.omissions.report()
    name = root.attributes.get("model", path.stem)
    return Tree(name=name, links=tuple(bodies.links), joints=tuple(bodies.joints)), side


def _standing(side: SideFile, bodies: Bodies) -> SideFile:
    """Return `side` with what the file says of the base, where it says nothing itself."""
    if not bodies.standing:
        return side
    standing = bodies.standing[0]
    return replace(
        side,
        base=standing.kind,
        height=standing.height if side.height is None else side.height,
        base_damping=side.base_damping if "base.damping" in side.given else standing.damping,
        base_armature=side.base_armature if "base.armature" in side.given else standing.armature,
        base_stiffness=side.base_stiffness if "base.stiffness" in side.given else standing.stiffness,
        base_rest_position=(side.base_rest_position if "base.rest_position" in side.given else standing.rest_position),
    )
