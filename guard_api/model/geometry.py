"""Shapes from URDF `<geometry>`, including the convex hulls of mesh files."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from guard_api.model.element import Element
from guard_api.model.inertia import as_vector
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, Vector3

SMALLEST = 1e-9
"""Size [m] below which a shape has no volume that arithmetic could use."""

LARGEST = 100.0
"""Size [m] beyond which a shape is noted as probably given in another unit."""


def read_geometry(node: Element) -> Shape | None:
    """Return the shape in the `<geometry>` of a collision or visual; None, reported, when there is none to use.

    Raises nothing: faults go to the element's problems. A visual's missing or unreadable mesh is only noted.
    """
    geometry = node.child("geometry", required=True)
    if geometry is None:
        return None
    shapes = list(geometry.children())
    if len(shapes) != 1:
        geometry.error(f"<geometry> holds {len(shapes)} shapes: it must hold one")
        return None
    shape = shapes[0]
    if shape.tag == "mesh":
        return _mesh(shape, only_looked_at=node.tag == "visual")
    if shape.tag in _PRIMITIVES:
        return _PRIMITIVES[shape.tag](shape)
    if node.tag == "collision":
        shape.error(f"<{shape.tag}> is no collision shape here: use sphere, box, cylinder, capsule or mesh")
    else:
        shape.note(f"a visual <{shape.tag}> is left out")
    return None


def find_mesh(filename: str, folder: Path) -> Path | None:
    """Return the file that a URDF in `folder` calls `filename`, or None.

    `package://name/path` is looked for in every folder above: as `name/path`, then as `path` inside a folder `name`.
    """
    if filename.startswith("package://"):
        package, _, inside = filename.removeprefix("package://").partition("/")
        above = [folder, *folder.parents]
        candidates = [base / package / inside for base in above]
        candidates += [base / inside for base in above if base.name == package]
    else:
        candidates = [folder / filename.removeprefix("file://")]
    return next((path for path in candidates if path.is_file()), None)


def hull_vertices(file: Path, scale: Vector3) -> tuple[Vector3, ...]:
    """Return the corners (V, 3) [m] of the convex hull of a mesh file whose coordinates are multiplied by `scale`.

    Raises ValueError, with the reason, for a file that is not a mesh or is flat.
    """
    return _hull_vertices(file, file.stat().st_mtime_ns, scale)


@lru_cache(maxsize=256)
def _hull_vertices(file: Path, modified: int, scale: Vector3) -> tuple[Vector3, ...]:
    """Load a mesh once for as long as its file is not `modified`: links often look as they collide."""
    import trimesh  # noqa: PLC0415  takes a second to import, needed for meshes only

    try:
        mesh = trimesh.load_mesh(file, process=False)
        points = np.asarray(mesh.vertices, float) * np.asarray(scale)
        if not np.isfinite(points).all():
            raise ValueError("it has vertices that are not finite")
        hull = trimesh.Trimesh(vertices=points, process=False).convex_hull
        corners = np.asarray(hull.vertices, float)
    except Exception as error:  # mesh loaders raise whatever their parsers meet
        reason = str(error).strip().partition("\n")[0]
        raise ValueError(f"{type(error).__name__}: {reason}") from error
    return tuple(as_vector(corner) for corner in corners)


def _mesh(node: Element, *, only_looked_at: bool) -> Shape | None:
    report = node.note if only_looked_at else node.error
    filename, scale = node.text("filename"), node.vector("scale", 3, (1.0, 1.0, 1.0))
    if not filename:
        return None
    file = find_mesh(filename, node.file.resolve().parent)
    if file is None:
        report(f"mesh file {filename!r} does not exist: put it where the URDF says, relative to {node.file.parent}")
        return None
    if 0.0 in scale:
        report(f"mesh scale {scale} flattens {filename!r}: no factor may be 0")
        return None
    try:
        vertices = hull_vertices(file, as_vector(scale))
    except ValueError as error:
        report(f"mesh file {filename!r} cannot be used ({error}): export it again as STL or OBJ")
        return None
    size = float(np.ptp(np.asarray(vertices), axis=0).max())
    if size > LARGEST:
        node.note(f"mesh {filename!r} is {size:.6g} m large; if it is in millimetres, give scale='0.001 0.001 0.001'")
    return Mesh(vertices=vertices, source=str(file))


def _box(node: Element) -> Box:
    x, y, z = _positive(node, "size", 3)
    return Box(half_extents=(0.5 * x, 0.5 * y, 0.5 * z))


def _length(node: Element, name: str) -> float:
    return _positive(node, name, 1)[0]


def _positive(node: Element, name: str, size: int) -> tuple[float, ...]:
    values = node.vector(name, size)
    if min(values) < SMALLEST:
        node.error(f"<{node.tag}> {name} {_plain(values)} must be positive (metres)")
        return (1.0,) * size
    if max(values) > LARGEST:
        node.note(f"<{node.tag}> {name} {_plain(values)} is more than {LARGEST:g} m: lengths are in metres")
    return values


def _plain(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:g}" for value in values)


_PRIMITIVES: dict[str, Callable[[Element], Shape]] = {
    "sphere": lambda node: Sphere(radius=_length(node, "radius")),
    "box": _box,
    "cylinder": lambda node: Cylinder(radius=_length(node, "radius"), half_length=0.5 * _length(node, "length")),
    "capsule": lambda node: Capsule(radius=_length(node, "radius"), half_length=0.5 * _length(node, "length")),
}
