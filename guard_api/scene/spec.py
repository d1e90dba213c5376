"""A scene: one robot, groups of bodies, a ground plane, and the physical settings that all engines share.

Friction of a contact is *one* number: against the ground or a static or driven body it is the moving body's own
coefficient; between two moving bodies the larger of the two. Restitution likewise. A backend that cannot express a pair
says so in `World.approximations`.

Phantoms (hazards, goals, ...) are not part of a scene's physics: the environment keeps them as arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from guard_api.conventions import GRAVITY
from guard_api.model.robot import RobotModel
from guard_api.shapes import Shape, Vector3

PhysicsKind: TypeAlias = Literal["phantom", "static", "dynamic", "driven"]
ContactPreset: TypeAlias = Literal["rigid", "native"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BodySpec:
    """One kind of object.

    physics: "phantom" (walked through, core only), "static" (immovable, placed at reset), "dynamic" (free body) or
    "driven" (moved by `World.drive`, pushes others, is never pushed).
    mass: [kg], dynamic bodies only; the inertia is that of the solid shape of uniform density.
    damping: rate [1/s] at which the linear and angular velocity of a dynamic body decay in free motion: drag, or what
    stands for rolling resistance, which not every engine has.
    height: z of the body's frame when placed [m]. keepout: radius kept free around it in layouts [m]; 0 makes it a mark
    that keeps nothing free, and of which nothing keeps clear.
    rgba: colour in 0..1, for renderers only.
    """

    shape: Shape
    physics: PhysicsKind
    mass: float = 0.0
    damping: float = 0.0
    friction: float = 1.0
    restitution: float = 0.0
    height: float = 0.0
    keepout: float = 0.4
    rgba: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where things may be put when an episode starts, and again when they respawn.

    rectangles: (xmin, ymin, xmax, ymax) [m] areas, chosen by their size; none stands for the environment's extents.
    The keepout of what is placed stays within them.
    locations: (x, y) [m] of the first ones when an episode starts, whatever else is there, instead of a free place.
    radius: (least, most) distance from the world's origin in the plane [m]. distance: the most in space [m].
    heights: (low, high) [m], drawn uniformly; None stands for the body's own height.
    clearance: least distance in space between the centre and the robot as it stands [m] (see `Snapshot.distance`); 0
    asks for nothing.
    apart: least distance in space between the centre and the robot's reference as it stands [m].
    onto: the group on one of whose bodies, drawn at random, the thing stands instead of on a free place; several stand
    on different ones, and what respawns stands on another one than before.
    last: whether it is placed after all that is not, in what that leaves free: in crowds, near the border.
    """

    rectangles: tuple[tuple[float, float, float, float], ...] = ()
    locations: tuple[tuple[float, float], ...] = ()
    radius: tuple[float, float] = (0.0, float("inf"))
    distance: float = float("inf")
    heights: tuple[float, float] | None = None
    clearance: float = 0.0
    apart: float = 0.0
    onto: str | None = None
    last: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyGroup:
    """`count` equal bodies under one name, such as eight hazards."""

    name: str
    body: BodySpec
    count: int
    placement: Placement = Placement()


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSpec:
    """Everything a backend needs to build a `World`.

    robot: the robot, or None for scenes of bodies alone (conformance tests).
    groups: physical body groups only; bodies are numbered through them in order: `State.body_*` axis 1.
    ground: whether an infinite plane z = 0 exists. gravity: (3,) [m/s^2], world axes.
    timestep: physics step [s]. preset: "rigid" brings the engines closest; "native" keeps each engine's defaults.
    """

    robot: RobotModel | None
    groups: tuple[BodyGroup, ...] = ()
    ground: bool = True
    gravity: Vector3 = GRAVITY
    timestep: float = 0.002
    preset: ContactPreset = "rigid"

    @property
    def num_bodies(self) -> int:
        """Number of physical bodies B."""
        return sum(group.count for group in self.groups)

    @property
    def bodies(self) -> tuple[BodySpec, ...]:
        """The spec of every physical body, in the order of `State.body_*`: (B,)."""
        return tuple(group.body for group in self.groups for _ in range(group.count))

    def body_slice(self, name: str) -> slice:
        """Return where group `name` lies on axis 1 of `State.body_*`. Raises KeyError when there is none."""
        first = 0
        for group in self.groups:
            if group.name == name:
                return slice(first, first + group.count)
            first += group.count
        raise KeyError(name)
