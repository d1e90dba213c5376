"""How a robot stands in the world: welded to it, sliding in its plane, or free."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.problems import Problems
from guard_api.model.robot import PLANAR_JOINTS, BaseKind, Joint, Link, RobotModel
from guard_api.model.sidefile import SideFile
from guard_api.model.tree import Tree, TreeJoint
from guard_api.shapes import Pose

WORLD = "world"
"""Name of the link in a URDF that stands for the world, and of the first link of a planar base."""

PLANAR_LINKS = (WORLD, "base_x", "base_y")
"""Massless links that the planar joints hang on, in order."""

LEVEL = 1e-6
"""Largest component of an axis [1] that counts as none."""

BASE_KINDS = ("planar", "floating")
"""Kinds of joints that only a base may have, below a link `world`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Base:
    """The base's kind, the root link's height where an episode starts [m], and the tree below the base joint."""

    kind: BaseKind
    height: float
    tree: Tree


def resolve_base(tree: Tree, side: SideFile, problems: Problems) -> Base:
    """Return the base that the side file states or that a planar or floating joint on a link `world` means.

    Raises ModelError with all `problems` when several joints hang on such a `world`, since then no tree is left.
    """
    first = tree.joints[0] if tree.joints else None
    stated: BaseKind | None = None
    height = side.height or 0.0
    if first and tree.links[0].name == WORLD and first.kind in BASE_KINDS:
        stated = "planar" if first.kind == "planar" else "floating"
        height = _height(first, side, problems)
        tree = _below_world(tree, problems)
    for joint in tree.joints:
        if joint.kind in BASE_KINDS:
            problems.error(
                joint.place,
                f"joint {joint.name!r} is {joint.kind}: only the first joint, below a link {WORLD!r}, may be",
            )
    if stated and side.base and stated != side.base:
        problems.error(
            f"{side.place}: base.kind", f"{side.base!r} contradicts the {stated} joint on {WORLD!r}: keep one"
        )
    kind = side.base or stated
    if kind is None:
        kind = "fixed"
        problems.note("no kind of base is stated: the robot is fixed to the world; else give [base] kind in robot.toml")
    if kind != "fixed" and tree.links[0].name == WORLD:
        problems.error(f"{side.place}: base.kind", f"{kind!r} contradicts the root link {WORLD!r}: remove that link")
    if kind == "planar":
        _report_reserved(tree, problems)
    return Base(kind=kind, height=height, tree=tree)


def with_base(model: RobotModel, side: SideFile) -> RobotModel:
    """Return `model` on its base: a planar one gets the joints x, y, yaw, the first at home height."""
    if model.base != "planar":
        return model
    parents = PLANAR_LINKS
    children = (*PLANAR_LINKS[1:], model.root)
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    heights = (model.home.height, 0.0, 0.0)
    joints = tuple(
        Joint(
            name=name,
            kind="continuous" if name == PLANAR_JOINTS[2] else "prismatic",
            parent=parents[i],
            child=children[i],
            origin=Pose(position=(0.0, 0.0, heights[i])),
            axis=axes[i],
            damping=side.base_damping[i],
            armature=side.base_armature[i],
            stiffness=side.base_stiffness[i],
            rest_position=side.base_rest_position[i],
        )
        for i, name in enumerate(PLANAR_JOINTS)
    )
    links = tuple(Link(name=name, mass=0.0) for name in PLANAR_LINKS)
    return replace(model, links=links + model.links, joints=joints + model.joints)


def without_base(model: RobotModel) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Return the links and joints of `model` from its root link on: those of a robot file."""
    skip = len(PLANAR_LINKS) if model.base == "planar" else 0
    return model.links[skip:], model.joints[skip:]


def footing_notes(model: RobotModel) -> tuple[str, ...]:
    """Return a sentence on a planar robot that meets the ground at a fixed height, without a joint that gives way.

    No mechanics says how hard such a robot presses on the ground: a ball held 0.1 mm in the floor feels 0 N in
    PyBullet, where it slides without friction, 150 N in MuJoCo and 6300 N in SAPIEN.
    """
    if model.base != "planar" or not model.collide_ground:
        return ()
    rest = np.zeros((1, len(model.joints)))
    poses = Kinematics(model).poses(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), rest)
    rising = {model.links[0].name: False}
    for joint in model.joints:  # parents before children
        axis = rotations.rotate(poses.quaternion[0, model.link_index(joint.child)], np.array(joint.axis))
        slides = joint.kind == "prismatic"
        gives = abs(axis[2]) > LEVEL if slides else bool(np.abs(axis[:2]).max() > LEVEL)
        rising[joint.child] = rising[joint.parent] or gives
    touching = [link.name for link in model.links if link.collisions]
    if not touching or any(rising[name] for name in touching):
        return ()
    return (
        f"the robot meets the ground at a fixed height, and nothing in it can give way ({', '.join(touching)}): "
        "how hard it presses and rubs is each engine's own; give it a vertical slide, or leave collide_ground out",
    )


def _height(joint: TreeJoint, side: SideFile, problems: Problems) -> float:
    x, y, z = joint.origin.position
    if x or y or joint.origin.quaternion != Pose().quaternion:
        problems.error(joint.place, f"joint {joint.name!r}: only the z of a base joint's origin may differ from 0")
    if joint.kind == "planar" and joint.axis != (0.0, 0.0, 1.0):
        problems.error(joint.place, f"planar joint {joint.name!r}: only a horizontal plane is supported, axis 0 0 1")
    if joint.damping or joint.friction_loss:
        problems.note(f"joint {joint.name!r}: its dynamics are ignored; give damping of a planar base in [base]")
    return z if side.height is None else side.height


def _below_world(tree: Tree, problems: Problems) -> Tree:
    world, base = tree.links[0], tree.joints[0]
    if world.properties or world.collisions or world.visuals:
        problems.error(world.place, f"link {WORLD!r} carries the robot: it must be empty")
    for other in tree.joints[1:]:
        if other.parent == WORLD:
            problems.error(other.place, f"joints {base.name!r} and {other.name!r} both hang on {WORLD!r}: keep one")
            raise problems.as_error()  # below the world there would be two trees
    return Tree(name=tree.name, links=tree.links[1:], joints=tree.joints[1:])


def _report_reserved(tree: Tree, problems: Problems) -> None:
    for reserved, items in ((PLANAR_LINKS, tree.links), (PLANAR_JOINTS, tree.joints)):
        for item in items:
            if item.name in reserved:
                problems.error(item.place, f"the name {item.name!r} belongs to the planar base: rename it")
