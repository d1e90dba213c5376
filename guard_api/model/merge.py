"""Merges what fixed joints hold together into single bodies, and says where every link went."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from guard_api import rotations
from guard_api.model.inertia import MassProperties, as_vector, combined, moved
from guard_api.model.problems import Problems
from guard_api.model.robot import Visual
from guard_api.model.tree import Tree, TreeCollision, TreeJoint, TreeLink
from guard_api.shapes import ORIGIN, Pose

NO_INERTIA = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """Links held together by fixed joints, in the frame of the first; `name` and `place` of the first not virtual.

    `members`: names of the links. `collisions`: each with the link it was written in.
    """

    name: str
    place: str
    members: tuple[str, ...]
    properties: MassProperties
    collisions: tuple[tuple[str, TreeCollision], ...]
    visuals: tuple[Visual, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Merged:
    """Bodies on moving joints, ordered like the tree: `joints[i].child == bodies[i + 1].name`.

    `where`: link name -> name of its body and pose of the link's frame in the body's axes.
    """

    bodies: tuple[Body, ...]
    joints: tuple[TreeJoint, ...]
    where: dict[str, tuple[str, Pose]]


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return `inner`, a pose in a frame, in the parent in which that frame has the pose `outer`."""
    if outer == Pose():
        return inner
    position = np.asarray(outer.position) + rotations.rotate(outer.quaternion, inner.position)
    turn = rotations.multiply(outer.quaternion, inner.quaternion)
    w, x, y, z = (float(value) for value in turn / math.copysign(float(np.linalg.norm(turn)), float(turn[0])))
    return Pose(position=as_vector(position), quaternion=(w, x, y, z))


def merge_fixed(tree: Tree, problems: Problems) -> Merged:
    """Return the ordered `tree` without fixed joints; every merge is noted, but those with virtual links.

    Inertias are combined about the common centre of mass; shapes keep their places. A link without mass properties
    adds none.
    """
    links = {link.name: link for link in tree.links}
    where = {tree.links[0].name: (tree.links[0].name, Pose())}
    members: dict[str, list[str]] = {tree.links[0].name: [tree.links[0].name]}
    joints: list[TreeJoint] = []
    for joint in tree.joints:
        body, pose = where[joint.parent]
        origin = compose(pose, joint.origin)
        if joint.kind == "fixed":
            where[joint.child] = (body, origin)
            members[body].append(joint.child)
            if not links[joint.parent].virtual:
                problems.note(f"fixed joint {joint.name!r}: link {joint.child!r} is merged into {body!r}")
        else:
            where[joint.child] = (joint.child, Pose())
            members[joint.child] = [joint.child]
            joints.append(replace(joint, parent=body, origin=origin))
    bodies = tuple(_body([(links[name], where[name][1]) for name in names]) for names in members.values())
    called = {first: body.name for first, body in zip(members, bodies, strict=True)}
    renamed = tuple(replace(joint, parent=called[joint.parent], child=called[joint.child]) for joint in joints)
    return Merged(
        bodies=bodies, joints=renamed, where={name: (called[body], pose) for name, (body, pose) in where.items()}
    )


def _body(parts: list[tuple[TreeLink, Pose]]) -> Body:
    first = next((link for link, _ in parts if not link.virtual), parts[0][0])
    masses = [moved(link.properties, pose) for link, pose in parts if link.properties]
    return Body(
        name=first.name,
        place=first.place,
        members=tuple(link.name for link, _ in parts),
        properties=combined(masses) if masses else MassProperties(mass=0.0, com=ORIGIN, inertia=NO_INERTIA),
        collisions=tuple(
            (link.name, replace(shape, pose=compose(pose, shape.pose)))
            for link, pose in parts
            for shape in link.collisions
        ),
        visuals=tuple(replace(shape, pose=compose(pose, shape.pose)) for link, pose in parts for shape in link.visuals),
    )
