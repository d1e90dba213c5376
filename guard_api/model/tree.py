"""What a robot file says, before its side file is applied: links and joints of any kind, fixed ones included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from guard_api.model.inertia import MassProperties
from guard_api.model.problems import Problems
from guard_api.model.robot import Visual
from guard_api.shapes import Pose, Shape, Vector3

TreeJointKind: TypeAlias = Literal["fixed", "revolute", "continuous", "prismatic", "ball", "planar", "floating"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeCollision:
    """A collision shape at `pose` in link axes; `name` (may be empty) is how a side file refers to it.

    friction: what the robot file says, for which the side file may have another.
    """

    name: str
    shape: Shape
    pose: Pose
    friction: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeLink:
    """A link as written. `properties` in link axes, None when the file gives none; `place` is `file:line`.

    virtual: it only stands between the joints of a body that has several, and yields its name when merged with it.
    """

    name: str
    place: str
    properties: MassProperties | None = None
    collisions: tuple[TreeCollision, ...] = ()
    visuals: tuple[Visual, ...] = ()
    virtual: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeJoint:
    """A joint as written; fields as in `guard_api.model.robot.Joint`; `place` is `file:line`.

    Axis and limits mean nothing on a ball, fixed or floating joint.
    """

    name: str
    kind: TreeJointKind
    parent: str
    child: str
    place: str
    origin: Pose
    axis: Vector3 = (1.0, 0.0, 0.0)
    limits: tuple[float, float] | None = None
    damping: float = 0.0
    friction_loss: float = 0.0
    armature: float = 0.0
    stiffness: float = 0.0
    rest_position: float = 0.0
    effort_limit: float = float("inf")
    velocity_limit: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Tree:
    """A robot file: after `ordered`, `joints[i].child == links[i + 1].name` with parents before children."""

    name: str
    links: tuple[TreeLink, ...]
    joints: tuple[TreeJoint, ...]


def ordered(tree: Tree, problems: Problems) -> Tree | None:
    """Return `tree` depth first, siblings in file order; None, with every reason reported, if it is not one tree."""
    before = len(problems.errors)
    _report_duplicates(tree, problems)
    complete = _report_missing_links(tree, problems)
    parent_joint: dict[str, TreeJoint] = {}
    for joint in tree.joints:
        first = parent_joint.setdefault(joint.child, joint)
        if joint.child and first is not joint:
            problems.error(
                joint.place,
                f"link {joint.child!r} is the child of joints {first.name!r} and {joint.name!r}: closed chains are "
                "not supported, cut the loop at one of them",
            )
    _report_loops(tree, parent_joint, problems)
    roots = list({link.name: link for link in tree.links if link.name not in parent_joint}.values())
    for extra in roots[1:] if complete else ():  # a joint without its link makes a root that is none
        problems.error(
            extra.place,
            f"link {extra.name!r} hangs on no joint, and neither does {roots[0].name!r}: a robot has one root",
        )
    if len(problems.errors) > before or not complete or not roots:
        return None
    return _depth_first(tree, roots[0])


def _report_missing_links(tree: Tree, problems: Problems) -> bool:
    """Return whether both ends of every joint exist; an end that is not even named was reported by its reader."""
    known = {link.name for link in tree.links}
    complete = True
    for joint in tree.joints:
        for role, name in (("parent", joint.parent), ("child", joint.child)):
            complete &= name in known
            if name and name not in known:
                problems.error(joint.place, f"joint {joint.name!r}: its {role} link {name!r} does not exist")
    return complete


def _report_duplicates(tree: Tree, problems: Problems) -> None:
    for kind, items in (("link", tree.links), ("joint", tree.joints)):
        first: dict[str, str] = {}
        for item in items:
            if item.name in first:
                problems.error(
                    item.place, f"{kind} name {item.name!r} is taken already ({first[item.name]}): rename one"
                )
            first.setdefault(item.name, item.place)


def _report_loops(tree: Tree, parent_joint: dict[str, TreeJoint], problems: Problems) -> None:
    grounded: set[str] = set()
    for link in tree.links:
        path: dict[str, TreeJoint] = {}
        name = link.name
        while name not in grounded and name in parent_joint and name not in path:
            path[name] = parent_joint[name]
            name = parent_joint[name].parent
        if name in path:
            loop = list(path.values())[list(path).index(name) :]
            names = " -> ".join(joint.name for joint in reversed(loop))
            problems.error(loop[-1].place, f"joints form a loop: {names}; hang one of their links elsewhere")
        grounded.update(path, (name,))


def _depth_first(tree: Tree, root: TreeLink) -> Tree:
    links = {link.name: link for link in tree.links}
    joints_of: dict[str, list[TreeJoint]] = {link.name: [] for link in tree.links}
    for joint in tree.joints:
        joints_of[joint.parent].append(joint)
    found: list[TreeJoint] = []
    pending = joints_of[root.name][::-1]
    while pending:
        joint = pending.pop()
        found.append(joint)
        pending.extend(joints_of[joint.child][::-1])
    return Tree(name=tree.name, links=(root, *(links[joint.child] for joint in found)), joints=tuple(found))
