"""Mass, centre of mass and inertia: of solid shapes, in another frame, and of several parts together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guard_api import rotations
from guard_api.shapes import ORIGIN, Box, Capsule, Cylinder, Matrix3, Mesh, Pose, Shape, Sphere, Vector3

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""Relative violation of the triangle inequality that is put down to the digits of a file."""

UNIT_INERTIA: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""What readers go on with in the place of an inertia that they refused, so that one fault is reported once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MassProperties:
    """`mass` [kg]; `com` (3,) [m]; `inertia` (3, 3) [kg m^2] about the com; both in the axes of one frame."""

    mass: float
    com: Vector3
    inertia: Matrix3


def of_shape(shape: Shape, density: float) -> MassProperties:
    """Return the mass properties of the solid `shape` of uniform `density` [kg/m^3], in the shape's own frame.

    Exact closed forms for the primitives; for a mesh the polyhedron of its hull, integrated exactly.
    Raises ValueError for a mesh whose vertices lie in one plane.
    """
    if isinstance(shape, Mesh):
        return _of_hull(shape.vertices, density)
    mass, moments = _of_primitive(shape, density)
    return MassProperties(mass=mass, com=ORIGIN, inertia=as_matrix(np.diag(moments)))


def moved(part: MassProperties, pose: Pose) -> MassProperties:
    """Return `part`, given in a frame, in the axes of the parent in which that frame has `pose`."""
    if pose == Pose():
        return part
    R = rotations.to_matrix(pose.quaternion)
    com = np.asarray(pose.position) + R @ np.asarray(part.com)
    inertia = R @ np.asarray(part.inertia) @ R.T
    return MassProperties(mass=part.mass, com=as_vector(com), inertia=as_matrix(0.5 * (inertia + inertia.T)))


def combined(parts: Sequence[MassProperties]) -> MassProperties:
    """Return `parts`, all in the same frame, as one rigid body (Huygens-Steiner); overlaps count twice.

    Raises ValueError when there are none.
    """
    if not parts:
        raise ValueError("no parts to combine")
    if len(parts) == 1:
        return parts[0]
    mass = sum(part.mass for part in parts)
    com = sum((part.mass * np.asarray(part.com) for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        r = np.asarray(part.com) - com
        inertia += np.asarray(part.inertia) + part.mass * (r @ r * np.eye(3) - np.outer(r, r))
    return MassProperties(mass=mass, com=as_vector(com), inertia=as_matrix(inertia))


def of_solids(solids: Iterable[tuple[Shape, Pose]], density: float) -> MassProperties:
    """Return the mass properties of shapes at their poses as one body of uniform `density` [kg/m^3].

    Overlapping volume is not subtracted: it counts once for every shape, as it does in MuJoCo.
    """
    return combined([moved(of_shape(shape, density), pose) for shape, pose in solids])


def impossibility(inertia: Matrix3) -> str | None:
    """Return why no distribution of mass has this `inertia` about its com, or None if one has."""
    smallest, middle, largest = (float(value) for value in np.linalg.eigvalsh(np.asarray(inertia)))
    if smallest < -ROUNDING * abs(largest) or largest < 0.0:
        return f"it is not positive definite (principal moments {smallest:.6g}, {middle:.6g}, {largest:.6g})"
    if largest > (smallest + middle) * (1.0 + ROUNDING):
        return f"its largest principal moment {largest:.6g} exceeds the sum of the others, {smallest + middle:.6g}"
    return None


def positive_definite(inertia: Matrix3) -> bool:
    """Return whether a free body with this `inertia` resists turning about every axis."""
    moments = np.linalg.eigvalsh(np.asarray(inertia))
    return bool(moments[0] > np.finfo(float).eps * moments[2])


def radius_of_gyration(properties: MassProperties) -> float:
    """Return how far from its com, about the worst axis, a point of the same mass would have the same inertia [m]."""
    return float(np.sqrt(np.linalg.eigvalsh(np.asarray(properties.inertia))[2] / properties.mass))


def as_vector(values: ArrayLike) -> Vector3:
    """Return three numbers as a tuple of Python floats."""
    x, y, z = (float(value) for value in np.asarray(values))
    return x, y, z


def as_matrix(values: ArrayLike) -> Matrix3:
    """Return a (3, 3) array as nested tuples of Python floats."""
    a, b, c = (as_vector(row) for row in np.asarray(values))
    return a, b, c


def _of_primitive(shape: Sphere | Box | Cylinder | Capsule, density: float) -> tuple[float, Array]:
    """Return mass and principal moments (3,) about the centre."""
    match shape:
        case Sphere(radius=r):
            mass = density * 4.0 / 3.0 * pi * r**3
            return mass, np.full(3, 0.4 * mass * r**2)
        case Box(half_extents=half):
            square = np.square(half)
            mass = density * 8.0 * float(np.prod(half))
            return mass, mass / 3.0 * (square.sum() - square)
        case Cylinder(radius=r, half_length=h):
            mass = density * 2.0 * pi * r**2 * h
            across = mass * (r**2 / 4.0 + h**2 / 3.0)
            return mass, np.array([across, across, 0.5 * mass * r**2])
        case Capsule(radius=r, half_length=h):
            tube, caps = density * 2.0 * pi * r**2 * h, density * 4.0 / 3.0 * pi * r**3
            # A hemisphere's centroid lies 3/8 r above its base, hence the cross term of the two caps.
            across = tube * (r**2 / 4.0 + h**2 / 3.0) + caps * (0.4 * r**2 + h**2 + 0.75 * h * r)
            return tube + caps, np.array([across, across, 0.5 * tube * r**2 + 0.4 * caps * r**2])


def _of_hull(vertices: Sequence[Vector3], density: float) -> MassProperties:
    """Sum signed tetrahedra from an inner point to every face of the hull.

    Source: the second moment of a tetrahedron with one corner at the origin, volume V and corners a, b, c is
    V/20 (aa' + bb' + cc' + ss') with s = a + b + c.
    """
    from scipy.spatial import ConvexHull, QhullError  # noqa: PLC0415  slow to import, needed for meshes only

    points = np.asarray(vertices, float)
    middle = points.mean(axis=0)
    try:
        hull = ConvexHull(points - middle)
    except QhullError as error:
        raise ValueError("the vertices of the mesh lie in one plane") from error
    corners = (points - middle)[hull.simplices]
    volumes = np.abs(np.linalg.det(corners)) / 6.0
    sums = corners.sum(axis=1)
    volume = float(volumes.sum())
    com = volumes @ sums / (4.0 * volume)
    second = np.einsum("t,tki,tkj->ij", volumes, corners, corners) + np.einsum("t,ti,tj->ij", volumes, sums, sums)
    second = second / 20.0 - volume * np.outer(com, com)
    inertia = density * (np.trace(second) * np.eye(3) - second)
    return MassProperties(mass=density * volume, com=as_vector(com + middle), inertia=as_matrix(inertia))
