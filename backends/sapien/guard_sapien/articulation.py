"""A GUARD robot as one PhysX articulation, with every hidden default cleared."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.model.robot import Joint, RobotModel
from guard_api.scene.spec import SceneSpec
from guard_api.shapes import Matrix3, Vector3
from guard_sapien.engine import physx, pose, sapien
from guard_sapien.shapes import attach
from guard_sapien.surfaces import ContactTable, robot_material

VIRTUAL_MASS = 1e-9
"""Mass of a massless link, relative to the mass of the robot; PhysX refuses zero."""

VIRTUAL_INERTIA = 1e-9
"""Inertia of a massless link, relative to the largest inertia of the robot's links."""

FRICTION_LOSS_DAMPING = 1e4
"""Slope of the velocity servo that stands for dry friction until its force limit [N m s/rad or N s/m]."""

UNLIMITED_SPEED = 1e6
"""Replaces PhysX's speed limits of 10 m/s, 50 rad/s and 100 rad/s per joint."""

_IGNORE_BITS = 32


@dataclass(frozen=True, slots=True)
class Articulation:
    """A robot inside a scene: PhysX's object, and its links (L,) and joints (J,) in the *model's* order."""

    engine: physx.PhysxArticulation
    links: tuple[physx.PhysxArticulationLinkComponent, ...]
    joints: tuple[physx.PhysxArticulationJoint, ...]

    def come_to_rest(self) -> None:
        """Put it at the origin, all joints at 0, without velocity or force."""
        zeros = np.zeros(len(self.joints), np.float32)
        self.engine.set_root_pose(sapien.Pose())
        self.engine.set_root_linear_velocity([0.0, 0.0, 0.0])
        self.engine.set_root_angular_velocity([0.0, 0.0, 0.0])
        self.engine.set_qpos(zeros)
        self.engine.set_qvel(zeros)
        self.engine.set_qf(zeros)


def add_robot(scene: sapien.Scene, spec: SceneSpec, robot: RobotModel, table: ContactTable) -> Articulation:
    """Build `robot` into `scene`. Raises BackendError for what PhysX would silently replace by something else."""
    ignored = ignored_bits(robot)
    collides = can_collide(spec, robot, ignored)
    tiny_mass, tiny_inertia = _virtual_body(robot)
    components: dict[str, physx.PhysxArticulationLinkComponent] = {}
    incoming = {joint.child: joint for joint in robot.joints}
    for link in robot.links:
        joint = incoming.get(link.name)
        component = physx.PhysxArticulationLinkComponent(components[joint.parent] if joint else None)
        if collides:
            for collision in link.collisions:
                material = robot_material(spec, collision.friction)
                facings = table.moving(material, robot.collide_ground)
                attach(component, collision.shape, collision.pose, facings, ignored[link.name])
        mass, inertia = (tiny_mass, tiny_inertia) if link.virtual else (link.mass, link.inertia)
        set_mass(component, f"link {link.name!r}", mass, link.com, inertia)
        _clear_link_defaults(component)
        if joint is None:
            # Outside the binding's type hints, but what its own builder uses for a root that floats.
            component.joint.set_type("undefined" if robot.floating else "fixed")  # type: ignore[arg-type]
        else:
            _set_joint(component.joint, joint)
        components[link.name] = component
    _place(scene, components)
    engine = components[robot.links[0].name].articulation
    joints = tuple(components[joint.child].joint for joint in robot.joints)
    for engine_joint, joint in zip(joints, robot.joints, strict=True):
        _set_joint_dynamics(engine_joint, joint, spec.timestep)
    engine.sleep_threshold = 0.0
    return Articulation(engine, tuple(components[link.name] for link in robot.links), joints)


def ignored_bits(robot: RobotModel) -> dict[str, int]:
    """Return link name -> bits; two links that share one never collide: those with only massless links between them.

    Direct parents and children need no bit, since PhysX leaves them out itself.
    """
    parent = {joint.child: joint.parent for joint in robot.joints}
    links = {link.name: link for link in robot.links}
    bits = dict.fromkeys(links, 0)
    next_bit = 0
    for name, link in links.items():
        ancestor, skipped = parent.get(name), False
        while ancestor is not None and links[ancestor].virtual:
            ancestor, skipped = parent.get(ancestor), True
        if skipped and ancestor is not None and link.collisions and links[ancestor].collisions:
            if next_bit == _IGNORE_BITS:
                raise BackendError(f"robot {robot.name!r}: PhysX can exempt {_IGNORE_BITS} link pairs from collision")
            bits[name] |= 1 << next_bit
            bits[ancestor] |= 1 << next_bit
            next_bit += 1
    return bits


def can_collide(spec: SceneSpec, robot: RobotModel, ignored: dict[str, int]) -> bool:
    """Return whether any shape of the robot can ever touch anything in this scene."""
    shaped = [link.name for link in robot.links if link.collisions]
    if not shaped:
        return False
    if spec.num_bodies or (spec.ground and robot.collide_ground):
        return True
    adjacent = {frozenset((joint.parent, joint.child)) for joint in robot.joints}
    return any(not ignored[a] & ignored[b] and frozenset((a, b)) not in adjacent for a, b in combinations(shaped, 2))


def principal_axes(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the principal moments (3,) and the rotation (3, 3) into their axes, the one nearest to the identity."""
    if np.count_nonzero(inertia - np.diag(np.diagonal(inertia))) == 0:
        return np.diagonal(inertia).copy(), np.eye(3)
    moments, axes = np.linalg.eigh(inertia)
    # Greedy assignment of eigenvectors to axes: close enough to the identity to stay away from pitch = 90 degrees.
    order, free = [0, 0, 0], [0, 1, 2]
    for row in np.argsort(-np.abs(axes).max(axis=1)):
        order[row] = max(free, key=lambda column: abs(axes[row, column]))
        free.remove(order[row])
    axes = axes[:, order] * np.where(np.diagonal(axes[:, order]) < 0, -1.0, 1.0)
    if np.linalg.det(axes) < 0:
        axes[:, 2] *= -1.0
    return moments[order], axes


def _virtual_body(robot: RobotModel) -> tuple[float, Matrix3]:
    """Return mass [kg] and isotropic inertia (3, 3) [kg m^2] of the robot's massless links."""
    mass = sum(link.mass for link in robot.links)
    inertia = max(float(np.trace(np.asarray(link.inertia))) / 3 for link in robot.links)
    tiny = VIRTUAL_INERTIA * inertia
    return VIRTUAL_MASS * mass, ((tiny, 0.0, 0.0), (0.0, tiny, 0.0), (0.0, 0.0, tiny))


def set_mass(component: physx.PhysxRigidBodyComponent, owner: str, mass: float, com: Vector3, inertia: Matrix3) -> None:
    """Give a body its mass [kg], centre of mass (3,) [m] and inertia (3, 3) [kg m^2] about it, body axes.

    Raises BackendError for zero or negative values, for which PhysX would substitute its own.
    """
    moments, axes = principal_axes(np.asarray(inertia, float))
    if not (mass > 0 and (moments > 0).all()):
        raise BackendError(f"{owner}: mass {mass} and principal inertia {moments} must be positive")
    component.set_mass(mass)
    component.set_cmass_local_pose(pose(com, rotations.from_matrix(axes)))
    component.set_inertia(moments.tolist())


def _clear_link_defaults(component: physx.PhysxArticulationLinkComponent) -> None:
    component.linear_damping = 0.0
    component.angular_damping = 0.0
    component.max_linear_velocity = UNLIMITED_SPEED
    component.max_angular_velocity = UNLIMITED_SPEED


def _set_joint(engine_joint: physx.PhysxArticulationJoint, joint: Joint) -> None:
    """Set type, frames and limits; PhysX's joints act along or about the x axis of the joint frame."""
    turn = _from_x(np.asarray(joint.axis, float))
    engine_joint.set_type("prismatic" if joint.kind == "prismatic" else "revolute_unwrapped")
    engine_joint.pose_in_parent = pose(joint.origin.position, rotations.multiply(joint.origin.quaternion, turn))
    engine_joint.pose_in_child = pose((0.0, 0.0, 0.0), turn)
    lower, upper = joint.limits or (-np.inf, np.inf)
    if not lower < upper:
        raise BackendError(f"joint {joint.name!r}: limits {joint.limits} must rise")
    engine_joint.set_limits(np.array([[lower, upper]], np.float32))


def _set_joint_dynamics(engine_joint: physx.PhysxArticulationJoint, joint: Joint, timestep: float) -> None:
    """Set armature and dry friction, and clear PhysX's load-dependent friction of 0.05."""
    engine_joint.friction = 0.0
    engine_joint.max_velocity = UNLIMITED_SPEED
    # The implicit part of the damping law: (M + A + h D) qdd = effort - D qd - bias.
    engine_joint.set_armature(np.array([joint.armature + timestep * joint.damping], np.float32))
    if joint.friction_loss:
        engine_joint.set_drive_properties(0.0, FRICTION_LOSS_DAMPING, force_limit=joint.friction_loss, mode="force")


def _from_x(axis: np.ndarray) -> np.ndarray:
    """Return the shortest rotation that turns the x axis into the unit `axis`: (4,)."""
    axis = axis / np.linalg.norm(axis)
    if axis[0] < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    q = np.array([1.0 + axis[0], 0.0, -axis[2], axis[1]])
    return q / np.linalg.norm(q)


def _place(scene: sapien.Scene, components: dict[str, physx.PhysxArticulationLinkComponent]) -> None:
    for name, component in components.items():
        entity = sapien.Entity()
        entity.name = component.name = name
        entity.add_component(component)
        scene.add_entity(entity)
