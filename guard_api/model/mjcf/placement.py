"""Where elements of MJCF are: `pos` with one of five notations of an orientation, and `fromto`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guard_api import rotations
from guard_api.model.element import Element
from guard_api.model.inertia import as_vector
from guard_api.model.mjcf.compiler import Compiler
from guard_api.shapes import IDENTITY, ORIGIN, Pose, Quaternion

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")

Array = NDArray[np.float64]

_AXES = dict(zip("xyz", np.eye(3), strict=True))
_LEAST = 1e-10
"""Length below which a vector has no direction."""


def read_pose(node: Element, compiler: Compiler) -> Pose:
    """Return the pose of an element in the axes of the body or frame that it stands in."""
    return Pose(position=as_vector(node.vector("pos", 3, ORIGIN)), quaternion=read_orientation(node, compiler))


def read_orientation(node: Element, compiler: Compiler) -> Quaternion:
    """Return the unit quaternion, w >= 0, of an element; the identity where it states none."""
    given = [name for name in ORIENTATIONS if name in node.attributes]
    if len(given) > 1:
        node.error(f"<{node.tag}> has both {given[0]} and {given[1]}: keep one")
    if not given:
        return IDENTITY
    turn = _READERS[given[0]](node, compiler)
    if turn is None:
        node.error(f"<{node.tag}> {given[0]}={node.attributes[given[0]]!r} is no orientation: its vectors vanish")
        return IDENTITY
    turn = turn / math.copysign(float(np.linalg.norm(turn)), float(turn[0]))
    w, x, y, z = (float(value) for value in turn)
    return w, x, y, z


def read_ends(node: Element) -> tuple[Pose, float] | None:
    """Return the pose and half the length of a shape `fromto` two points: its centre, z from the second to the first.

    None, reported, if the points coincide.
    """
    ends = np.asarray(node.vector("fromto", 6))
    axis = ends[:3] - ends[3:]
    turn = _towards(axis)
    if turn is None:
        node.error(f"<{node.tag}> fromto={node.attributes['fromto']!r}: the two points coincide")
        return None
    for name in ORIENTATIONS:
        if name in node.attributes:
            node.error(f"<{node.tag}> has both fromto and {name}: keep one")
    w, x, y, z = (float(value) for value in turn)
    pose = Pose(position=as_vector(0.5 * (ends[:3] + ends[3:])), quaternion=(w, x, y, z))
    return pose, 0.5 * float(np.linalg.norm(axis))


def _quat(node: Element, compiler: Compiler) -> Array | None:
    turn = np.asarray(node.vector("quat", 4))
    return turn if np.linalg.norm(turn) >= _LEAST else None


def _axis_angle(node: Element, compiler: Compiler) -> Array | None:
    x, y, z, angle = node.vector("axisangle", 4)
    axis = _unit((x, y, z))
    return None if axis is None else rotations.from_axis_angle(axis, angle * compiler.angle)


def _euler(node: Element, compiler: Compiler) -> Array:
    """Return the turns about the axes of `eulerseq`: lower case, about axes that turn along; upper case, fixed ones."""
    turn = np.asarray(IDENTITY)
    for axis, angle in zip(compiler.euler_sequence, node.vector("euler", 3), strict=True):
        step = rotations.from_axis_angle(_AXES[axis.lower()], angle * compiler.angle)
        turn = rotations.multiply(turn, step) if axis.islower() else rotations.multiply(step, turn)
    return turn


def _xy_axes(node: Element, compiler: Compiler) -> Array | None:
    """Return the orientation with the given x axis and, made orthogonal to it, the given y axis."""
    values = np.asarray(node.vector("xyaxes", 6, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)))
    x = _unit(values[:3])
    if x is None:
        return None
    y = _unit(values[3:] - (x @ values[3:]) * x)
    return None if y is None else rotations.from_matrix(np.stack([x, y, rotations.cross(x, y)], axis=1))


def _z_axis(node: Element, compiler: Compiler) -> Array | None:
    return _towards(node.vector("zaxis", 3))


def _towards(axis: ArrayLike) -> Array | None:
    """Return the shortest turn of z into `axis`; None if it has no direction."""
    z = _unit(axis)
    if z is None:
        return None
    across = rotations.cross((0.0, 0.0, 1.0), z)
    sine = float(np.linalg.norm(across))
    about = across / sine if sine >= _LEAST else _AXES["x"]
    return rotations.from_axis_angle(about, math.atan2(sine, z[2]))


def _unit(vector: ArrayLike) -> Array | None:
    values = np.asarray(vector, float)
    norm = float(np.linalg.norm(values))
    return values / norm if norm >= _LEAST else None


_READERS = {
    "quat": _quat,
    "axisangle": _axis_angle,
    "euler": _euler,
    "xyaxes": _xy_axes,
    "zaxis": _z_axis,
}
