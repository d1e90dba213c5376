"""Joints of a body, and the chain of links that several of them become."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from guard_api import rotations
from guard_api.model.element import Element
from guard_api.model.inertia import as_vector
from guard_api.model.merge import compose
from guard_api.model.mjcf.attributes import choice, increasing, limited, not_negative, symmetric_bound
from guard_api.model.mjcf.compiler import Compiler
from guard_api.model.tree import TreeJoint, TreeJointKind
from guard_api.shapes import ORIGIN, Pose, Vector3

ON_AXIS = 1e-12
"""Distance [m] from a hinge's axis below which a body's origin lies on it."""

_KINDS: dict[str, TreeJointKind] = {"hinge": "continuous", "slide": "prismatic", "ball": "ball", "free": "floating"}


class BodyJoint(NamedTuple):
    """A joint as its body states it: `joint` without its ends and origin.

    link: what hangs on it, unless that is the body itself. anchor: (3,) [m] of its axis in body axes, the body's own
    origin where that does as well. start: its value where the body is drawn [rad or m].
    """

    joint: TreeJoint
    link: str
    anchor: Vector3 = ORIGIN
    start: float = 0.0


def read_joint(node: Element, name: str, link: str, frame: Pose, compiler: Compiler) -> BodyJoint:
    """Return a `<joint>` whose defaults are applied, or a `<freejoint>`, inside `frame`, a pose in body axes.

    name, link: of the joint and of the link that hangs on it.
    """
    written = "free" if node.tag == "freejoint" else choice(node, "type", "hinge", tuple(_KINDS))
    unit = compiler.angle if written in {"hinge", "ball"} else 1.0
    axis = _axis(node, name, frame) if written in {"hinge", "slide"} else (0.0, 0.0, 1.0)
    anchor = compose(frame, Pose(position=as_vector(node.vector("pos", 3, ORIGIN)))).position
    start = unit * node.number("ref", 0.0) if written in {"hinge", "slide"} else 0.0
    joint = TreeJoint(
        name=name,
        kind=_KINDS[written],
        parent="",
        child="",
        place=f"{node.file}:{node.line}",
        origin=Pose(),
        axis=axis,
        damping=not_negative(node, "damping"),
        friction_loss=not_negative(node, "frictionloss"),
        armature=not_negative(node, "armature"),
        stiffness=not_negative(node, "stiffness"),
        rest_position=unit * node.number("springref", 0.0),
        effort_limit=_effort_limit(node, compiler),
    )
    _refuse(node, joint)
    if limited(node, "limited", "range", compiler.automatic_limits):
        joint = _with_limits(node, joint, unit)
    return BodyJoint(joint, link, anchor if _matters(joint, anchor) else ORIGIN, start)


def chain(parent: str, body: str, pose: Pose, place: str, joints: Sequence[BodyJoint]) -> Iterator[TreeJoint]:
    """Yield the joints that carry `body`, which has `pose` in the axes of its `parent`.

    Joints act in order, each in the frame that the one before leaves. Where the last one stands away from the body's
    origin, a fixed joint leads from it to the body.
    """
    ends = len(joints) - 1 if joints and joints[-1].anchor == ORIGIN else None
    link, at = parent, pose
    for number, (joint, between, anchor, start) in enumerate(joints):
        child = body if number == ends else between
        here = compose(compose(at, Pose(position=anchor)), _undone(joint, start))
        yield replace(joint, parent=link, child=child, origin=here)
        link, at = child, Pose(position=as_vector(-np.asarray(anchor)))
    if link != body:
        yield TreeJoint(name=f"{body}.fixed", kind="fixed", parent=link, child=body, place=place, origin=at)


def _undone(joint: TreeJoint, start: float) -> Pose:
    """Return the displacement by minus `start`: the body is drawn where the joint's value is `start`."""
    if start == 0.0:
        return Pose()
    if joint.kind == "prismatic":
        return Pose(position=as_vector(-start * np.asarray(joint.axis)))
    w, x, y, z = (float(value) for value in rotations.from_axis_angle(joint.axis, -start))
    return Pose(quaternion=(w, x, y, z))


def _axis(node: Element, name: str, frame: Pose) -> Vector3:
    axis = rotations.rotate(frame.quaternion, node.vector("axis", 3, (0.0, 0.0, 1.0)))
    norm = float(np.linalg.norm(axis))
    if norm < 1e-10:
        node.error(f"joint {name!r}: the axis is zero: give it a direction")
        return 0.0, 0.0, 1.0
    return as_vector(axis / norm)


def _matters(joint: TreeJoint, anchor: Vector3) -> bool:
    """Return whether the anchor is another than the body's origin for the motion, too."""
    if joint.kind in {"prismatic", "floating"}:
        return False
    if joint.kind == "ball":
        return anchor != ORIGIN
    return float(np.linalg.norm(rotations.cross(joint.axis, anchor))) > ON_AXIS


def _with_limits(node: Element, joint: TreeJoint, unit: float) -> TreeJoint:
    if joint.kind not in {"continuous", "prismatic"}:
        node.error(
            f"joint {joint.name!r}: limits of a {node.attributes.get('type')} joint are not supported: remove them"
        )
        return joint
    lower, upper = increasing(node, "range")
    if joint.kind == "continuous" and unit == 1.0 and max(abs(lower), abs(upper)) > 2.0 * math.pi:
        node.note(f"joint {joint.name!r}: range {lower:g} {upper:g} exceeds a turn: <compiler angle='radian'> is set")
    kind: TreeJointKind = "revolute" if joint.kind == "continuous" else "prismatic"
    return replace(joint, kind=kind, limits=(unit * lower, unit * upper))


def _effort_limit(node: Element, compiler: Compiler) -> float:
    if limited(node, "actuatorfrclimited", "actuatorfrcrange", compiler.automatic_limits):
        return symmetric_bound(node, "actuatorfrcrange")
    return math.inf


def _refuse(node: Element, joint: TreeJoint) -> None:
    """Report what would make another robot if it were left out."""
    if any(node.vector("springdamper", 2, (0.0, 0.0))):
        node.error(f"joint {joint.name!r}: springdamper is not supported: give stiffness and damping")
    if joint.kind == "floating":
        for name in ("damping", "frictionloss", "armature", "stiffness"):
            if node.number(name, 0.0) != 0.0:
                node.error(f"a free joint with {name} is not supported: use <freejoint>, which has no defaults")
    if joint.kind == "ball" and joint.stiffness:
        node.error(f"joint {joint.name!r}: the spring of a ball joint is not supported: use three hinges")
