"""From a robot's two files to a `RobotModel`; all problems of both are reported at once."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from guard_api.model.ball import expand_balls
from guard_api.model.base import footing_notes, resolve_base, with_base
from guard_api.model.inertia import of_solids, positive_definite, radius_of_gyration
from guard_api.model.merge import Body, merge_fixed
from guard_api.model.mjcf.reader import read_mjcf
from guard_api.model.problems import Problems
from guard_api.model.references import check_references, place_actuators, place_frame, place_segments, place_sensors
from guard_api.model.robot import Collision, Home, Joint, JointKind, Link, RobotModel
from guard_api.model.sidefile import DEFAULT, SideFile, read_side_file
from guard_api.model.tree import Tree, TreeCollision, TreeJoint, TreeLink, ordered
from guard_api.model.urdf import read_urdf

SIDE_FILE = "robot.toml"
MJCF_SUFFIX = ".xml"

SMALLEST_RADIUS, LARGEST_RADIUS = 1e-4, 10.0
"""A link's radius of gyration [m] beyond these is more likely a slip of units."""


def read_robot(file: Path, side_file: Path | None = None, *, name: str | None = None) -> RobotModel:
    """Return the robot of a URDF or MJCF (.xml) file and its side file, named `name` or as in the file.

    Without `side_file`, the `robot.toml` beside the file is used if there is one. Raises ModelError that lists every
    problem of both files, one per line, with file and line or key.
    """
    problems = Problems()
    beside = file.parent / SIDE_FILE
    if side_file is None and beside.is_file():
        side_file = beside
    if side_file is None:
        problems.note(f"no {SIDE_FILE}: a robot with the default settings, and what {file.name} says of them")
    side = read_side_file(side_file, problems) if side_file else SideFile()
    if file.suffix == MJCF_SUFFIX:
        tree, side = read_mjcf(file, side, problems)
    else:
        tree = read_urdf(file, problems)
    if tree is None:
        raise problems.as_error()
    return build_robot(replace(tree, name=name or tree.name), side, problems)


def build_robot(tree: Tree, side: SideFile, problems: Problems) -> RobotModel:
    """Return the robot that `tree` and `side` describe. Raises ModelError with all `problems`, old ones included."""
    tree, side = expand_balls(tree, side, problems)
    written = {link.name for link in tree.links if not link.virtual}
    check_references(tree, side, problems)
    in_order = ordered(tree, problems)
    if in_order is None:
        problems.note("masses and inertias are checked once the joints make a tree")
        raise problems.as_error()
    base = resolve_base(in_order, side, problems)
    tree = replace(base.tree, links=tuple(_with_mass(link, side, problems) for link in base.tree.links))
    merged = merge_fixed(tree, problems)
    carriers = {joint.parent for joint in merged.joints}
    if base.kind == "floating":
        carriers.discard(merged.bodies[0].name)  # it hangs on no joint, so it cannot do without mass
    for body in merged.bodies[1:] if base.kind == "fixed" else merged.bodies:
        _check_mass(body, carriers, side, problems)
        if body.properties.mass == 0.0 and body.name in written:
            problems.note(f"link {body.name!r} is empty: it is a massless link between two joints")
    links = tuple(_link(body, side) for body in merged.bodies)
    joints = tuple(_joint(joint, side) for joint in merged.joints)
    actuators = place_actuators(side.actuators, merged)
    sensors = place_sensors(side, merged, problems)
    _note_home(joints, side, problems)
    problems.raise_if_any()
    model = RobotModel(
        name=tree.name,
        base=base.kind,
        root=links[0].name,
        links=links,
        joints=joints,
        actuators=actuators,
        reference=place_frame(side.reference, merged) if side.reference else None,
        lidar=tuple(place_frame(frame, merged) for frame in side.lidar),
        segments=place_segments(side.segments, merged),
        sensors=sensors,
        home=Home(height=base.height, joint_position=dict(side.joint_position)),
        keepout=side.keepout,
        spatial=side.spatial,
        reach=side.reach,
        timestep=side.timestep,
        substeps=side.substeps,
        collide_ground=base.kind != "planar" if side.collide_ground is None else side.collide_ground,
        licence=side.licence,
        notes=tuple(problems.notes),
    )
    model = with_base(model, side)
    return replace(model, notes=(*model.notes, *footing_notes(model), *_lacking(model)))


def _lacking(model: RobotModel) -> Iterator[str]:
    """Yield a sentence on everything without which `model` can be built, but hardly be what was meant."""
    if not model.actuators:
        yield f"no [[actuators]]: nothing can move the robot, and no environment takes it; add them to {SIDE_FILE}"
    if model.actuators and not model.sensors:
        yield f"no [[sensors]]: a policy sees the task, but nothing of the robot; add them to {SIDE_FILE}"
    if model.base == "floating" and not any(link.collisions for link in model.links):
        yield "no link has a collision shape: the robot falls through the floor, for ever; add <collision>"
    bounded = [joint.name for joint in model.joints if math.isfinite(joint.velocity_limit)]
    if bounded:
        yield f"velocity limits are not enforced ({', '.join(bounded)}): give damping or less effort where they matter"


def _with_mass(link: TreeLink, side: SideFile, problems: Problems) -> TreeLink:
    """Return `link`, with mass properties from its collision shapes if it has none and a density is stated."""
    if link.properties or not link.collisions or side.density is None:
        return link
    properties = of_solids([(shape.shape, shape.pose) for shape in link.collisions], side.density)
    problems.note(
        f"link {link.name!r} has no <inertial>: {properties.mass:.6g} kg from its collision shapes at "
        f"{side.density:g} kg/m^3"
    )
    return replace(link, properties=properties)


def _check_mass(body: Body, carriers: set[str], side: SideFile, problems: Problems) -> None:
    """Report a moving body that no engine can move; only empty `carriers` of other bodies may be massless."""
    if body.properties.mass > 0.0:
        if not positive_definite(body.properties.inertia):
            problems.error(body.place, f"link {body.name!r} moves, but its inertia is zero about an axis: give all")
            return
        radius = radius_of_gyration(body.properties)
        if not SMALLEST_RADIUS <= radius <= LARGEST_RADIUS:
            problems.note(f"link {body.name!r} has a radius of gyration of {radius:.2g} m: inertias are in kg m^2")
        return
    if body.collisions:
        problems.error(
            body.place,
            f"link {body.name!r} moves but has no <inertial>: add one, or state density = ... in {side.place} to "
            "compute it from the collision shapes",
        )
    elif body.visuals or body.name not in carriers:
        problems.error(
            body.place,
            f"link {body.name!r} moves but has neither <inertial> nor collision shapes to compute it from: add one",
        )


def _link(body: Body, side: SideFile) -> Link:
    return Link(
        name=body.name,
        mass=body.properties.mass,
        com=body.properties.com,
        inertia=body.properties.inertia,
        collisions=tuple(
            Collision(
                shape=written.shape,
                pose=written.pose,
                friction=_friction(link, written, side),
            )
            for link, written in body.collisions
        ),
        visuals=body.visuals,
    )


def _friction(link: str, written: TreeCollision, side: SideFile) -> float:
    names = (written.name, link, DEFAULT)
    return next((side.friction[name] for name in names if name in side.friction), written.friction)


def _joint(joint: TreeJoint, side: SideFile) -> Joint:
    def chosen(by_name: dict[str, float], own: float) -> float:
        return by_name.get(joint.name, by_name.get(DEFAULT, own))

    kind: JointKind = "prismatic" if joint.kind == "prismatic" else "continuous"
    return Joint(
        name=joint.name,
        kind="revolute" if joint.kind == "revolute" else kind,
        parent=joint.parent,
        child=joint.child,
        origin=joint.origin,
        axis=joint.axis,
        limits=joint.limits,
        damping=chosen(side.damping, joint.damping),
        friction_loss=joint.friction_loss,
        armature=chosen(side.armature, joint.armature),
        stiffness=chosen(side.stiffness, joint.stiffness),
        rest_position=chosen(side.rest_position, joint.rest_position),
        effort_limit=joint.effort_limit,
        velocity_limit=joint.velocity_limit,
    )


def _note_home(joints: tuple[Joint, ...], side: SideFile, problems: Problems) -> None:
    for joint in joints:
        position = side.joint_position.get(joint.name, 0.0)
        if joint.limits and not joint.limits[0] <= position <= joint.limits[1]:
            lower, upper = joint.limits
            problems.note(f"joint {joint.name!r} starts at {position:g}, outside its limits {lower:g}, {upper:g}")
