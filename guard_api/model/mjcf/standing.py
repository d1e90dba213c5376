"""How the outermost body stands in the world: by a free joint, on a planar base, on joints, or fixed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from guard_api.model.base import WORLD
from guard_api.model.element import Element
from guard_api.model.mjcf.joints import BodyJoint, chain
from guard_api.model.robot import PLANAR_JOINTS, BaseKind
from guard_api.model.tree import TreeJoint
from guard_api.shapes import ORIGIN, Pose, Vector3

_PLANAR = (("prismatic", (1.0, 0.0, 0.0)), ("prismatic", (0.0, 1.0, 0.0)), ("continuous", (0.0, 0.0, 1.0)))
"""Kinds and axes of the joints that are a planar base, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """Kind of base, height [m] of the outermost body, and the joints below a link `world`; none if it is the root.

    The others are of a planar base, by joint. planar: names in the file of the joints that are the base's.
    """

    kind: BaseKind
    height: float
    joints: tuple[TreeJoint, ...]
    planar: tuple[str, ...] = ()
    damping: Vector3 = ORIGIN
    armature: Vector3 = ORIGIN
    stiffness: Vector3 = ORIGIN
    rest_position: Vector3 = ORIGIN


def stand(node: Element, body: str, pose: Pose, joints: Sequence[BodyJoint], stated: BaseKind | None) -> Standing:
    """Return how `body`, at `pose` in the world, stands there; `stated`: the kind of base in the side file."""
    place = f"{node.file}:{node.line}"
    free = any(joint.kind == "floating" for joint, *_ in joints)
    if (free and stated not in {None, "floating"}) or (joints and not free and stated == "floating"):
        node.error(f"the joints of body {body!r} contradict base.kind = {stated!r} in robot.toml: keep one")
    if free and len(joints) > 1:
        node.error(f"body {body!r} has a free joint and others: a free joint must be the only one")
        joints = [joint for joint in joints if joint.joint.kind == "floating"][:1]
    if stated == "planar" and not free:
        return _planar(node, body, pose, place, joints)
    if stated == "floating" and not joints:
        joints = [BodyJoint(_base_joint("floating", body, Pose(), place), body)]
        free = True
    if free:
        return Standing(kind="floating", height=pose.position[2], joints=tuple(chain(WORLD, body, pose, place, joints)))
    x, y, height = pose.position
    aside = replace(pose, position=(x, y, 0.0))
    fixed = not joints and aside == Pose()
    below = () if fixed else tuple(chain(WORLD, body, aside, place, joints))
    return Standing(kind="fixed", height=height, joints=below)


def _planar(node: Element, body: str, pose: Pose, place: str, joints: Sequence[BodyJoint]) -> Standing:
    """Return a planar base with the dynamics of the three joints that the file writes for it, if it does."""
    for fault in _faults(joints):
        node.error(f"body {body!r} cannot stand on a planar base: {fault}")
    written = [joint for joint, *_ in joints] if len(joints) == 3 else []

    def of_joints(field: str) -> Vector3:
        x, y, yaw = (float(getattr(joint, field)) for joint in written) if written else ORIGIN
        return x, y, yaw

    return Standing(
        kind="planar",
        height=pose.position[2],
        joints=(_base_joint("planar", body, pose, place),),
        planar=tuple(joint.name for joint in written),
        damping=of_joints("damping"),
        armature=of_joints("armature"),
        stiffness=of_joints("stiffness"),
        rest_position=of_joints("rest_position"),
    )


def _faults(joints: Sequence[BodyJoint]) -> Iterator[str]:
    """Yield why these joints, if there are any, are not a planar base."""
    if joints and tuple((joint.kind, joint.axis) for joint, *_ in joints) != _PLANAR:
        yield "its joints must be slide 1 0 0, slide 0 1 0, hinge 0 0 1, in this order and without range"
    for joint, _, anchor, start in joints:
        if anchor != ORIGIN or start:
            yield f"joint {joint.name!r} has pos or ref, which its {'/'.join(PLANAR_JOINTS)} have not"
        if joint.friction_loss or joint.effort_limit < float("inf"):
            yield f"joint {joint.name!r} has frictionloss or actuatorfrcrange, which a base has not"


def _base_joint(kind: BaseKind, body: str, pose: Pose, place: str) -> TreeJoint:
    return TreeJoint(
        name=f"{body}.base",
        kind="planar" if kind == "planar" else "floating",
        parent=WORLD,
        child=body,
        place=place,
        origin=pose,
        axis=(0.0, 0.0, 1.0),
    )
