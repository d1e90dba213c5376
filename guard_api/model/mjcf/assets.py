"""What geoms refer to by name: mesh files and the colours of materials."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from guard_api.model.element import Element
from guard_api.model.geometry import hull_vertices
from guard_api.model.inertia import MassProperties, as_matrix, as_vector, of_shape
from guard_api.model.mjcf.attributes import choice
from guard_api.model.mjcf.compiler import Compiler
from guard_api.model.mjcf.defaults import Defaults
from guard_api.shapes import Mesh, Vector3

AS_CONVEX = 1e-6
"""Share of its hull that a mesh may lack and still be convex, but for rounding."""

Rgba = tuple[float, float, float, float]

_REFERENCE = {"refpos": (0.0, 0.0, 0.0), "refquat": (1.0, 0.0, 0.0, 0.0)}


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshAsset:
    """A mesh file: `scale` of its coordinates; `solid`: which inside has mass.

    solid: "convex", that of its hull; "exact", its own; "legacy", its own if that is convex: MuJoCo, whose default
    this is, counts parts of others twice.
    """

    name: str
    file: Path
    scale: Vector3
    solid: str

    def shape(self) -> Mesh:
        """Return the convex hull. Raises ValueError, with the reason, for a file that is no mesh or is flat."""
        return Mesh(vertices=hull_vertices(self.file, self.scale), source=str(self.file))

    def mass_properties(self, density: float) -> MassProperties:
        """Return those of the solid that the mesh bounds. Raises ValueError for a mesh without a clear one."""
        hull = of_shape(self.shape(), density)
        if self.solid == "convex":
            return hull
        whole = _solid(self.file, self.file.stat().st_mtime_ns, self.scale, density)
        if self.solid == "legacy" and abs(whole.mass - hull.mass) > AS_CONVEX * hull.mass:
            raise ValueError("it is not convex, so say inertia='exact' or inertia='convex' in <mesh>")
        return whole


@dataclass(frozen=True, slots=True, kw_only=True)
class Assets:
    """Meshes and material colours, by name; None for those that were found at fault."""

    meshes: dict[str, MeshAsset | None]
    colours: dict[str, Rgba | None]


def read_assets(root: Element, compiler: Compiler, defaults: Defaults) -> Assets:
    """Return the meshes and colours in all `<asset>` elements."""
    nodes = [defaults.applied(node, None) for asset in root.children("asset") for node in asset.children()]
    meshes = [node for node in nodes if node.tag == "mesh"]
    return Assets(
        meshes={_mesh_name(node): _mesh(node, compiler) for node in meshes},
        colours={node.attributes.get("name", ""): read_rgba(node) for node in nodes if node.tag == "material"},
    )


def read_rgba(node: Element) -> Rgba | None:
    """Return the colour in attribute `rgba`, clipped to 0..1; None when there is none."""
    if "rgba" not in node.attributes:
        return None
    r, g, b, a = (min(max(value, 0.0), 1.0) for value in node.vector("rgba", 4))
    return r, g, b, a


def _mesh_name(node: Element) -> str:
    return node.attributes.get("name", Path(node.attributes.get("file", "")).stem)


def _mesh(node: Element, compiler: Compiler) -> MeshAsset | None:
    if "vertex" in node.attributes or "builtin" in node.attributes:
        node.error("a mesh without a file is not supported: save it as STL or OBJ and name that file")
        return None
    for name, neutral in _REFERENCE.items():
        if node.vector(name, len(neutral), neutral) != neutral:
            node.error(f"<mesh> {name} is not supported: move the vertices in the mesh file")
    inertia = choice(node, "inertia", "legacy", ("convex", "exact", "legacy", "shell"))
    if inertia == "shell":
        node.error('<mesh> inertia="shell" is not supported: give the body an <inertial>')
    scale = as_vector(node.vector("scale", 3, (1.0, 1.0, 1.0)))
    if 0.0 in scale:
        node.error(f"<mesh> scale {scale} flattens it: no factor may be 0")
        return None
    name = node.text("file")
    if not name:
        return None
    written = Path(Path(name).name) if compiler.strip_path else Path(name)
    file = node.file.resolve().parent / compiler.mesh_folder / written
    if not file.is_file():
        node.error(f"mesh file {name!r} does not exist: put it into {node.file.parent / compiler.mesh_folder}")
        return None
    return MeshAsset(name=_mesh_name(node), file=file, scale=scale, solid=inertia)


@lru_cache(maxsize=64)
def _solid(file: Path, modified: int, scale: Vector3, density: float) -> MassProperties:
    """Integrate over the inside of a mesh, once for as long as its file is not `modified`."""
    import trimesh  # noqa: PLC0415  takes a second to import, needed for meshes only

    mesh = trimesh.load_mesh(file, process=True)
    mesh.apply_scale(scale)
    if not mesh.is_watertight:
        raise ValueError("it is not closed: close it, or say inertia='convex' in <mesh>")
    mesh.density = density if mesh.volume > 0.0 else -density  # a mesh may be inside out
    whole = mesh.mass_properties
    return MassProperties(
        mass=float(whole.mass), com=as_vector(whole.center_mass), inertia=as_matrix(np.asarray(whole.inertia))
    )
