"""Geoms: their shapes, places, masses, and whether they touch things or are only looked at."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from guard_api.model.element import Element
from guard_api.model.geometry import SMALLEST
from guard_api.model.inertia import MassProperties, as_matrix, moved, of_shape
from guard_api.model.merge import compose
from guard_api.model.mjcf.assets import MeshAsset, read_rgba
from guard_api.model.mjcf.attributes import choice, flag, not_negative, numbers
from guard_api.model.mjcf.document import Document
from guard_api.model.mjcf.placement import read_ends, read_pose
from guard_api.model.problems import did_you_mean
from guard_api.model.robot import Visual
from guard_api.model.tree import TreeCollision
from guard_api.shapes import ORIGIN, Box, Capsule, Cylinder, Pose, Shape, Sphere

DENSITY = 1000.0
"""Density [kg/m^3] of geoms that state neither density nor mass."""

FRICTION = (1.0, 0.005, 0.0001)
"""Sliding, torsional and rolling friction where a geom states none."""

LAST_VISIBLE_GROUP = 2
"""Geoms of higher groups are hidden unless someone asks for them: collision shapes below a nicer look."""

_SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3, "mesh": 0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipsoid:
    """A shape that may have mass but touches nothing: `radii` (3,) [m] along the frame axes."""

    radii: tuple[float, float, float]


class Geom(NamedTuple):
    """A geom in body axes; `mesh` is the solid whose hull is the `shape`, if it is one."""

    node: Element
    shape: Shape | Ellipsoid
    pose: Pose
    mesh: MeshAsset | None = None


def read_geom(node: Element, frame: Pose, document: Document) -> Geom | None:
    """Return a geom whose defaults are applied, inside `frame`, a pose in body axes; None if it was found at fault."""
    kind = choice(node, "type", "mesh" if "mesh" in node.attributes else "sphere", tuple(_SIZES))
    if "mesh" in node.attributes and kind != "mesh":
        node.error(f"a {kind} fitted to a mesh is not supported: write its size, or make it type='mesh'")
        return None
    if flag(node, "shellinertia", False):
        node.error("<geom> shellinertia is not supported: give the body an <inertial>")
    if kind == "mesh":
        return _mesh_geom(node, compose(frame, read_pose(node, document.compiler)), document)
    placed = _between(node, kind) if "fromto" in node.attributes else _at(node, kind, document)
    if placed is None:
        return None
    size, pose = placed
    if min(size) < SMALLEST:
        node.error(f"<geom> {kind} size {' '.join(f'{value:g}' for value in size)} must be positive (metres)")
        return None
    return Geom(node, _shape(kind, size), compose(frame, pose))


def mass_properties(geom: Geom, document: Document) -> MassProperties | None:
    """Return the mass of a solid geom, in body axes; None if it has none or its group is not counted."""
    node = geom.node
    first, last = document.compiler.inertia_groups
    if not first <= node.number("group", 0.0) <= last:
        return None
    mass, density = not_negative(node, "mass"), not_negative(node, "density", DENSITY)
    if "mass" in node.attributes:
        unit = _solid(geom, 1.0) if mass > 0.0 else None
        part = unit and _scaled(unit, mass / unit.mass)
    else:
        part = _solid(geom, density) if density > 0.0 else None
    return part and moved(part, geom.pose)


def collision(geom: Geom, document: Document) -> TreeCollision | None:
    """Return the shape that touches things; None for a geom that touches nothing."""
    node = geom.node
    bits = node.number("contype", 1.0), node.number("conaffinity", 1.0)
    if bits == (0.0, 0.0):
        return None
    if bits != (1.0, 1.0):
        document.omissions.add("a geom touches everything, whatever contype and conaffinity other than 0, 0 say", node)
    if isinstance(geom.shape, Ellipsoid):
        node.error("an ellipsoid is no collision shape here: use capsule or box, or contype='0' conaffinity='0'")
        return None
    sliding = numbers(node, "friction", 1, 3, FRICTION)
    if sliding[0] < 0.0:
        node.error(f"<geom> friction {sliding[0]:g} must not be negative")
    if sliding[1:] != FRICTION[1 : len(sliding)]:
        document.omissions.add("torsional and rolling friction are ignored", node)
    return TreeCollision(name=node.attributes.get("name", ""), shape=geom.shape, pose=geom.pose, friction=sliding[0])


def visual(geom: Geom, document: Document) -> Visual | None:
    """Return how the geom looks; None for one that is hidden."""
    node = geom.node
    rgba, material, colours = read_rgba(node), node.attributes.get("material"), document.assets.colours
    if rgba is None and material is not None:
        if material not in colours:
            node.error(f"material {material!r} is not in <asset>: {did_you_mean(material, colours)}")
        rgba = colours.get(material)
    if node.number("group", 0.0) > LAST_VISIBLE_GROUP or (rgba is not None and rgba[3] == 0.0):
        return None
    if isinstance(geom.shape, Ellipsoid):
        document.omissions.add("the look of an ellipsoid is left out", node)
        return None
    look = Visual(shape=geom.shape, pose=geom.pose)
    return look if rgba is None else replace(look, rgba=rgba)


def _at(node: Element, kind: str, document: Document) -> tuple[tuple[float, ...], Pose] | None:
    """Return the sizes of a primitive, half lengths as in MJCF, and its pose in the axes around it."""
    size = _size(node, _SIZES[kind])
    return None if size is None else (size[: _SIZES[kind]], read_pose(node, document.compiler))


def _between(node: Element, kind: str) -> tuple[tuple[float, ...], Pose] | None:
    """Return the same of a primitive that reaches from one point to another, as wide as its first size."""
    if kind == "sphere":
        node.error("a sphere cannot have fromto: use pos and size")
        return None
    size, ends = _size(node, 1), read_ends(node)
    if size is None or ends is None:
        return None
    pose, half = ends
    return (*size[:1] * (_SIZES[kind] - 1), half), pose


def _size(node: Element, least: int) -> tuple[float, ...] | None:
    if "size" not in node.attributes:
        node.error("<geom> has no size: add size=...")
        return None
    return numbers(node, "size", least, 3, ()) or None


def _shape(kind: str, size: tuple[float, ...]) -> Shape | Ellipsoid:
    match kind, size:
        case "sphere", (radius,):
            return Sphere(radius=radius)
        case "capsule", (radius, half):
            return Capsule(radius=radius, half_length=half)
        case "cylinder", (radius, half):
            return Cylinder(radius=radius, half_length=half)
        case "box", (x, y, z):
            return Box(half_extents=(x, y, z))
        case "ellipsoid", (x, y, z):
            return Ellipsoid(radii=(x, y, z))
    raise TypeError(f"no geom {kind} of {len(size)} sizes")


def _mesh_geom(node: Element, pose: Pose, document: Document) -> Geom | None:
    name, meshes = node.text("mesh"), document.assets.meshes
    if name and name not in meshes:
        node.error(f"mesh {name!r} is not in <asset>: {did_you_mean(name, meshes)}")
    asset = meshes.get(name)
    if asset is None:
        return None
    try:
        return Geom(node, asset.shape(), pose, asset)
    except ValueError as error:
        node.error(f"mesh {name!r} cannot be used ({error}): export {asset.file.name} again as STL or OBJ")
        return None


def _solid(geom: Geom, density: float) -> MassProperties | None:
    """Return the mass properties in the geom's own axes; None, reported, for a mesh that has none."""
    if geom.mesh:
        try:
            return geom.mesh.mass_properties(density)
        except ValueError as error:
            geom.node.error(f"mesh {geom.mesh.name!r} has no clear mass: {error}, or give the body an <inertial>")
            return None
    if isinstance(geom.shape, Ellipsoid):
        square = np.square(geom.shape.radii)
        mass = density * 4.0 / 3.0 * math.pi * float(np.prod(geom.shape.radii))
        moments = mass / 5.0 * (square.sum() - square)
        return MassProperties(mass=mass, com=ORIGIN, inertia=as_matrix(np.diag(moments)))
    return of_shape(geom.shape, density)


def _scaled(part: MassProperties, factor: float) -> MassProperties:
    return MassProperties(mass=factor * part.mass, com=part.com, inertia=as_matrix(factor * np.asarray(part.inertia)))
