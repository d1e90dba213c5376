"""GUARD's shapes as PhysX's: capsules, cylinders and planes lie along x there."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Pose, Shape, Sphere
from guard_sapien.engine import physx, pose
from guard_sapien.surfaces import Facing, Material

X_TO_Z = (np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0)
"""The rotation that turns the x axis into the z axis: (w, x, y, z)."""

CYLINDER_NOTE = "PhysX has no round cylinder: {owner} collides as a convex polyhedron, which rolls with a loss"


def attach(
    component: physx.PhysxRigidBaseComponent, shape: Shape, at: Pose, facings: Iterable[Facing], ignore: int = 0
) -> None:
    """Attach `shape` at `at` to an actor, once per facing.

    ignore: bits of robot link pairs that must not collide; shapes of one robot that share a bit pass through another.
    """
    for facing in facings:
        engine_shape = _shape(shape, _material(facing.material))
        turn = X_TO_Z if isinstance(shape, Capsule | Cylinder) else (1.0, 0.0, 0.0, 0.0)
        engine_shape.local_pose = pose(at.position, rotations.multiply(at.quaternion, turn))
        engine_shape.set_collision_groups([facing.bits, facing.bits, ignore, 1 if ignore else 0])
        component.attach(engine_shape)


def attach_ground(component: physx.PhysxRigidStaticComponent, facings: Iterable[Facing]) -> None:
    """Attach the plane z = 0, once per facing."""
    for facing in facings:
        plane = physx.PhysxCollisionShapePlane(_material(facing.material))
        plane.local_pose = pose((0.0, 0.0, 0.0), X_TO_Z)
        plane.set_collision_groups([facing.bits, facing.bits, 0, 0])
        component.attach(plane)


def _shape(shape: Shape, material: physx.PhysxMaterial) -> physx.PhysxCollisionShape:
    match shape:
        case Sphere():
            return physx.PhysxCollisionShapeSphere(_positive(shape, shape.radius), material)
        case Box():
            half = [_positive(shape, extent) for extent in shape.half_extents]
            return physx.PhysxCollisionShapeBox(half, material)
        case Capsule():
            radius, half_length = _positive(shape, shape.radius), _positive(shape, shape.half_length)
            return physx.PhysxCollisionShapeCapsule(radius, half_length, material)
        case Cylinder():
            radius, half_length = _positive(shape, shape.radius), _positive(shape, shape.half_length)
            return physx.PhysxCollisionShapeCylinder(radius, half_length, material)
        case Mesh():
            vertices = np.asarray(shape.vertices, np.float32)
            try:
                return physx.PhysxCollisionShapeConvexMesh(vertices, [1.0, 1.0, 1.0], material)
            except RuntimeError as error:
                raise BackendError(f"PhysX cannot make a convex hull of {shape.source}: {error}") from error


def _material(material: Material) -> physx.PhysxMaterial:
    friction, restitution = material
    return physx.PhysxMaterial(friction, friction, restitution)


def _positive(shape: Shape, size: float) -> float:
    """Return `size`, which PhysX would accept silently even when it is not a size."""
    if not (np.isfinite(size) and size > 0):
        raise BackendError(f"{shape}: sizes must be positive and finite")
    return float(size)
