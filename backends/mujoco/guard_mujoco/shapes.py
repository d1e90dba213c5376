"""GUARD's shapes as MuJoCo geoms."""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np

from guard_api import rotations
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Pose, Shape, Sphere

_GEOM = mujoco.mjtGeom


def add_geom(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, shape: Shape, pose: Pose) -> mujoco.MjsGeom:
    """Add `shape` at `pose` in the axes of `body`: without mass of its own, touching in pairs only."""
    geom = body.add_geom(name=name, mass=0.0, contype=0, conaffinity=0)
    geom.pos, geom.quat = list(pose.position), list(pose.quaternion)
    match shape:
        case Sphere(radius=r):
            geom.type, geom.size = _GEOM.mjGEOM_SPHERE, [r, 0.0, 0.0]
        case Box(half_extents=half):
            geom.type, geom.size = _GEOM.mjGEOM_BOX, list(half)
        case Cylinder(radius=r, half_length=h):
            geom.type, geom.size = _GEOM.mjGEOM_CYLINDER, [r, h, 0.0]
        case Capsule(radius=r, half_length=h):
            geom.type, geom.size = _GEOM.mjGEOM_CAPSULE, [r, h, 0.0]
        case Mesh(vertices=vertices):
            geom.type, geom.meshname = _GEOM.mjGEOM_MESH, _mesh_of(spec, vertices)
    return geom


def set_inertia(body: mujoco.MjsBody, mass: float, com: tuple[float, ...], inertia: np.ndarray) -> None:
    """Set the mass [kg], `com` (3,) [m] and `inertia` (3, 3) about it of `body`, all in its own axes."""
    body.mass, body.explicitinertial = mass, True
    body.ipos = list(com)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = np.asarray(inertia).tolist()
    # Principal axes are left to the compiler unless the body's own axes are principal: then they stay exact.
    if xy == xz == yz == 0.0:
        body.inertia = [xx, yy, zz]
    else:
        body.fullinertia = [xx, yy, zz, xy, xz, yz]


def compose(parent: Pose, child: Pose) -> Pose:
    """Return the pose in the outer frame of a frame that has pose `child` in the frame with pose `parent`."""
    position = np.asarray(parent.position) + rotations.rotate(parent.quaternion, child.position)
    quaternion = rotations.multiply(parent.quaternion, child.quaternion)
    return Pose(position=tuple(position.tolist()), quaternion=tuple(quaternion.tolist()))


def _mesh_of(spec: mujoco.MjSpec, vertices: tuple[tuple[float, float, float], ...]) -> str:
    name = f"mesh{len(spec.meshes)}"
    mesh = spec.add_mesh(name=name, uservert=np.asarray(vertices, float).ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    return name
