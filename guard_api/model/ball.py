"""Ball joints as chains of three hinges: the model knows joints of one degree of freedom only."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from guard_api.model.problems import Problems
from guard_api.model.sidefile import SideFile
from guard_api.model.tree import Tree, TreeJoint, TreeLink
from guard_api.shapes import Pose, Vector3

AXES: dict[str, Vector3] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Suffixes of the hinges' names, and their axes in the child's link axes, from the parent to the child."""


def ball_hinges(name: str) -> tuple[str, ...]:
    """Return the names of the three hinges that stand for the ball joint `name`."""
    return tuple(f"{name}_{suffix}" for suffix in AXES)


def expand_balls(tree: Tree, side: SideFile, problems: Problems) -> tuple[Tree, SideFile]:
    """Return `tree` with three hinges for each ball joint, and `side` with their armature, damping and stiffness.

    Every hinge has the ball's dynamics and limits of effort. The child turns by Rx(a) Ry(b) Rz(c); the massless links
    between are named like the hinges that they hang on.
    """
    balls = [joint for joint in tree.joints if joint.kind == "ball"]
    if not balls:
        return tree, side
    for joint in balls:
        x, y, z = ball_hinges(joint.name)
        problems.note(
            f"ball joint {joint.name!r} becomes the hinges {x!r}, {y!r}, {z!r}, which are singular where {y!r} "
            "stands at +-90 degrees"
        )
    between = [
        TreeLink(name=name, place=joint.place, virtual=True) for joint in balls for name in ball_hinges(joint.name)[:2]
    ]
    joints = [part for joint in tree.joints for part in (_hinges(joint) if joint.kind == "ball" else (joint,))]
    names = [joint.name for joint in balls]
    tree = replace(tree, links=(*tree.links, *between), joints=tuple(joints))
    return tree, replace(
        side,
        armature=_spread(side.armature, names),
        damping=_spread(side.damping, names),
        stiffness=_spread(side.stiffness, names),
    )


def _hinges(ball: TreeJoint) -> Iterator[TreeJoint]:
    names = ball_hinges(ball.name)
    parents, children = (ball.parent, *names[:2]), (*names[:2], ball.child)
    origins = (ball.origin, Pose(), Pose())
    for name, axis, parent, child, origin in zip(names, AXES.values(), parents, children, origins, strict=True):
        yield replace(
            ball, name=name, kind="continuous", parent=parent, child=child, origin=origin, axis=axis, limits=None
        )


def _spread(values: dict[str, float], balls: list[str]) -> dict[str, float]:
    """Return `values` with that of a ball given to those of its hinges that have none."""
    of_hinges = {hinge: values[ball] for ball in balls if ball in values for hinge in ball_hinges(ball)}
    return of_hinges | {name: value for name, value in values.items() if name not in balls}
