"""What a picture shows: shapes at places in the world, read from neutral data alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import Collision, RobotModel, Visual
from guard_api.physics.state import State
from guard_api.scene.spec import BodyGroup, BodySpec, SceneSpec
from guard_api.shapes import Shape

Array = NDArray[np.float64]
Colour: TypeAlias = tuple[float, float, float, float]

BARE: Colour = (1.0, 0.6, 0.0, 1.0)
"""Colour of a robot that has no visuals, so that its collision shapes are shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A shape at `position` (3,) [m], `quaternion` (4,), world axes; translucent where `rgba`'s last number is < 1."""

    shape: Shape
    position: Array
    quaternion: Array
    rgba: Colour


def robot_parts(robot: RobotModel, position: Array, quaternion: Array) -> list[Part]:
    """Return the parts of `robot` whose link frames are at `position` (L, 3) [m] and `quaternion` (L, 4).

    The visuals of all links; the collision shapes where the robot has no visual at all.
    """
    bare = not any(link.visuals for link in robot.links)
    shown: list[tuple[int, Visual | Collision]] = []
    for i, link in enumerate(robot.links):
        shown += [(i, item) for item in (link.collisions if bare else link.visuals)]
    return [
        Part(
            shape=item.shape,
            position=position[i] + rotations.rotate(quaternion[i], item.pose.position),
            quaternion=rotations.multiply(quaternion[i], item.pose.quaternion),
            rgba=item.rgba if isinstance(item, Visual) else BARE,
        )
        for i, item in shown
    ]


def scene_parts(scene: SceneSpec, state: State, world: int) -> list[Part]:
    """Return the robot and the physical bodies of one world of `scene` in `state`."""
    parts = []
    if scene.robot is not None:
        parts += robot_parts(scene.robot, state.link_position[world], state.link_quaternion[world])
    places = zip(scene.bodies, state.body_position[world], state.body_quaternion[world], strict=True)
    return parts + [_body(body, position, quaternion) for body, position, quaternion in places]


def phantom_parts(groups: Sequence[BodyGroup], bodies: Mapping[str, Array], world: int) -> list[Part]:
    """Return the phantoms among `groups` of one world, upright, at `bodies` name -> (N, count, 3) [m]."""
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    phantoms: Iterable[BodyGroup] = (group for group in groups if group.body.physics == "phantom")
    return [_body(group.body, position, upright) for group in phantoms for position in bodies[group.name][world]]


def _body(body: BodySpec, position: Array, quaternion: Array) -> Part:
    return Part(shape=body.shape, position=position, quaternion=quaternion, rgba=body.rgba)
