"""From a `SceneSpec` to one PhysX scene: one world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from guard_api.errors import BackendError
from guard_api.model import inertia
from guard_api.scene.spec import BodySpec, SceneSpec
from guard_api.shapes import Cylinder, Pose
from guard_sapien.articulation import UNLIMITED_SPEED, Articulation, add_robot, can_collide, ignored_bits, set_mass
from guard_sapien.engine import open_scene, physx, sapien
from guard_sapien.shapes import CYLINDER_NOTE, attach, attach_ground
from guard_sapien.surfaces import ContactTable

Body: TypeAlias = physx.PhysxRigidDynamicComponent | physx.PhysxRigidStaticComponent


@dataclass(frozen=True, slots=True)
class Copy:
    """One world: its scene and physics system, the robot in it, and the bodies (B,) in the scene's order.

    first_link: number of the robot's first link among the scene's entities, which `Scene.pack_poses` follows; the
    others come after it in the model's order.
    """

    scene: sapien.Scene
    system: physx.PhysxCpuSystem
    robot: Articulation | None
    bodies: tuple[Body, ...]
    first_link: int


def touches(spec: SceneSpec) -> bool:
    """Return whether anything in a world of `spec` can ever touch anything."""
    robot = spec.robot
    return spec.num_bodies > 0 or (robot is not None and can_collide(spec, robot, ignored_bits(robot)))


def compile_scene(spec: SceneSpec, table: ContactTable, worlds: int) -> list[Copy]:
    """Build `worlds` worlds of `spec` into one PhysX scene: more than one only if nothing `touches` anything.

    Raises BackendError for what PhysX cannot build.
    """
    scene = open_scene(spec)
    system = scene.physx_system
    assert isinstance(system, physx.PhysxCpuSystem)
    copies, first_link = [], 0
    if spec.ground and touches(spec):
        component = physx.PhysxRigidStaticComponent()
        attach_ground(component, table.ground())
        _add(scene, component, "ground")
        first_link += 1
    for _ in range(worlds):
        bodies = [_body(body, table, spec.timestep) for body in spec.bodies]
        for index, component in enumerate(bodies):
            _add(scene, component, f"body_{index}")
        robot = add_robot(scene, spec, spec.robot, table) if spec.robot else None
        copies.append(Copy(scene, system, robot, tuple(bodies), first_link + len(bodies)))
        first_link += len(bodies) + (len(spec.robot.links) if spec.robot else 0)
    return copies


def check(spec: SceneSpec) -> None:
    """Raise BackendError when PhysX would accept `spec` but simulate something else."""
    if not spec.timestep > 0:
        raise BackendError(f"timestep {spec.timestep} must be positive")
    for group in spec.groups:
        if group.body.physics == "phantom":
            raise BackendError(f"group {group.name!r} is a phantom: phantoms live in the environment, not in physics")
        if group.body.physics == "dynamic" and not group.body.mass > 0:
            raise BackendError(f"group {group.name!r}: a dynamic body needs a mass > 0, not {group.body.mass}")


def cylinder_notes(spec: SceneSpec) -> tuple[str, ...]:
    """Return one sentence for everything whose cylinders become polyhedra."""
    owners = [f"group {g.name!r}" for g in spec.groups if isinstance(g.body.shape, Cylinder)]
    links = spec.robot.links if spec.robot else ()
    owners += [f"link {x.name!r}" for x in links if any(isinstance(c.shape, Cylinder) for c in x.collisions)]
    return tuple(CYLINDER_NOTE.format(owner=owner) for owner in owners)


def _body(body: BodySpec, table: ContactTable, timestep: float) -> Body:
    material = (body.friction, body.restitution)
    if body.physics == "static":
        static = physx.PhysxRigidStaticComponent()
        attach(static, body.shape, at=Pose(), facings=table.fixed(material))
        return static
    moving = physx.PhysxRigidDynamicComponent()
    # PhysX multiplies velocities by 1 - h d in a timestep h: with this d that is exp(-c h).
    moving.linear_damping = moving.angular_damping = -np.expm1(-body.damping * timestep) / timestep
    moving.max_linear_velocity = moving.max_angular_velocity = UNLIMITED_SPEED
    moving.sleep_threshold = 0.0
    if body.physics == "driven":
        moving.kinematic = True
        attach(moving, body.shape, at=Pose(), facings=table.fixed(material))
        return moving
    attach(moving, body.shape, at=Pose(), facings=table.moving(material))
    solid = inertia.of_shape(body.shape, 1.0)
    scale = body.mass / solid.mass
    moments = inertia.as_matrix(scale * np.asarray(solid.inertia))
    if np.abs(solid.com).max() > 1e-6:
        raise BackendError(f"{body.shape}: a body's frame must be at its centre of mass, which is at {solid.com}")
    set_mass(moving, f"{body.shape}", body.mass, solid.com, moments)
    return moving


def _add(scene: sapien.Scene, component: physx.PhysxRigidBaseComponent, name: str) -> None:
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(component)
    scene.add_entity(entity)
