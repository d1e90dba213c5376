"""Neutral shapes as the engine's collision shapes, and inertias as the principal axes it wants."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from guard_api import rotations
from guard_api.model import inertia as solids
from guard_api.model.robot import Collision
from guard_api.shapes import IDENTITY, Box, Capsule, Cylinder, Mesh, Pose, Quaternion, Shape, Sphere
from guard_bullet.engine import Client, pybullet

NO_SHAPE = -1


def xyzw(quaternion: ArrayLike) -> list[float]:
    """Return the engine's order (x, y, z, w) of a neutral quaternion (4,)."""
    w, x, y, z = np.asarray(quaternion, float).tolist()
    return [x, y, z, w]


@dataclass(frozen=True, slots=True, kw_only=True)
class Principal:
    """An inertia about its own axes: `moments` (3,) [kg m^2] and the `quaternion` that turns them into link axes."""

    moments: tuple[float, float, float]
    quaternion: Quaternion


def principal(inertia: ArrayLike) -> Principal:
    """Return the principal moments and axes of `inertia` (3, 3); a diagonal one keeps its axes untouched."""
    matrix = np.asarray(inertia, float)
    if not np.any(matrix - np.diag(np.diag(matrix))):
        x, y, z = np.diag(matrix).tolist()
        return Principal(moments=(x, y, z), quaternion=IDENTITY)
    moments, axes = np.linalg.eigh(matrix)
    order = max(itertools.permutations(range(3)), key=lambda p: sum(abs(axes[k, p[k]]) for k in range(3)))
    moments, axes = moments[list(order)], axes[:, list(order)]
    axes = axes * np.where(np.diag(axes) < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, int(np.argmin(np.abs(np.diag(axes))))] *= -1.0
    x, y, z = moments.tolist()
    w, i, j, k = rotations.from_matrix(axes).tolist()
    return Principal(moments=(x, y, z), quaternion=(w, i, j, k))


def body_frame(shape: Shape) -> Principal:
    """Return principal moments of the solid `shape` of unit mass, and its principal axes in the body's axes."""
    solid = solids.of_shape(shape, 1.0)
    return principal(np.asarray(solid.inertia) / solid.mass)


def body_collision(shape: Shape) -> Collision:
    """Return `shape` moved so that its centre of mass is at the body's frame; primitives are there already."""
    x, y, z = solids.of_shape(shape, 1.0).com
    return Collision(shape=shape, pose=Pose(position=(0.0 - x, 0.0 - y, 0.0 - z)))


def collision_shape(client: Client, collisions: Sequence[Collision]) -> int:
    """Return the engine's number of one rigid union of `collisions`, or NO_SHAPE for none."""
    if not collisions:
        return NO_SHAPE
    if len(collisions) == 1:
        shape, pose = collisions[0].shape, collisions[0].pose
        return pybullet.createCollisionShape(
            **_arguments(shape),
            collisionFramePosition=pose.position,
            collisionFrameOrientation=xyzw(pose.quaternion),
            physicsClientId=client,
        )
    with tempfile.TemporaryDirectory(prefix="guard_bullet_") as folder:
        return _union(client, [c.shape for c in collisions], [c.pose for c in collisions], Path(folder))


def _union(client: Client, shapes: list[Shape], poses: list[Pose], folder: Path) -> int:
    """Return one compound shape; the engine takes meshes of a compound from files only."""
    rows: list[dict[str, Any]] = []
    for number, shape in enumerate(shapes):
        row = _arguments(shape)
        if isinstance(shape, Mesh):
            path = folder / f"hull_{number}.obj"
            path.write_text(_point_cloud(shape))
            row = {"shapeType": pybullet.GEOM_MESH, "fileName": str(path)}
        rows.append(row)
    zero = [0.0, 0.0, 0.0]
    return pybullet.createCollisionShapeArray(
        shapeTypes=[row["shapeType"] for row in rows],
        radii=[row.get("radius", 0.0) for row in rows],
        halfExtents=[row.get("halfExtents", zero) for row in rows],
        lengths=[row.get("height", 0.0) for row in rows],
        fileNames=[row.get("fileName", "") for row in rows],
        meshScales=[[1.0, 1.0, 1.0]] * len(rows),
        planeNormals=[[0.0, 0.0, 1.0]] * len(rows),
        flags=[0] * len(rows),
        collisionFramePositions=[list(pose.position) for pose in poses],
        collisionFrameOrientations=[xyzw(pose.quaternion) for pose in poses],
        physicsClientId=client,
    )


def _arguments(shape: Shape) -> dict[str, Any]:
    """Return the engine's arguments of a primitive; lengths are full lengths, capsules without their caps."""
    match shape:
        case Sphere():
            return {"shapeType": pybullet.GEOM_SPHERE, "radius": shape.radius}
        case Box():
            return {"shapeType": pybullet.GEOM_BOX, "halfExtents": list(shape.half_extents)}
        case Cylinder():
            return {"shapeType": pybullet.GEOM_CYLINDER, "radius": shape.radius, "height": 2.0 * shape.half_length}
        case Capsule():
            return {"shapeType": pybullet.GEOM_CAPSULE, "radius": shape.radius, "height": 2.0 * shape.half_length}
        case Mesh():
            return {"shapeType": pybullet.GEOM_MESH, "vertices": [list(vertex) for vertex in shape.vertices]}


def _point_cloud(mesh: Mesh) -> str:
    """Return a Wavefront text with the hull's vertices; every vertex must be in a face to be read at all."""
    points = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in (map(float, vertex) for vertex in mesh.vertices))
    count = len(mesh.vertices)
    faces = "".join(f"f {i + 1} {(i + 1) % count + 1} {(i + 2) % count + 1}\n" for i in range(count))
    return points + faces
