"""Collision and visual shapes: the same five for robots and scene bodies, in every backend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

Vector3: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
Matrix3: TypeAlias = tuple[Vector3, Vector3, Vector3]

IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)
ORIGIN: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sphere:
    """A ball of `radius` [m] about the frame origin."""

    radius: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A cuboid with `half_extents` (3,) [m] along the frame axes."""

    half_extents: Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class Cylinder:
    """A cylinder about the frame's z axis: `radius` [m], `half_length` [m] (half of the full height)."""

    radius: float
    half_length: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Capsule:
    """A capsule about the frame's z axis: `radius` [m]; `half_length` [m] of the cylindrical part, caps excluded."""

    radius: float
    half_length: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Mesh:
    """The convex hull of a mesh file, already scaled: `vertices` (V, 3) [m] of the hull, `source` the file."""

    vertices: tuple[Vector3, ...]
    source: str


Shape: TypeAlias = Sphere | Box | Cylinder | Capsule | Mesh


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """A frame in its parent's axes: `position` (3,) [m], unit `quaternion` (w, x, y, z)."""

    position: Vector3 = ORIGIN
    quaternion: Quaternion = IDENTITY
