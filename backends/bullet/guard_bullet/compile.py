"""A `SceneSpec` as the contents of one engine instance, and what of it the engine cannot express."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from guard_api.errors import BackendError
from guard_api.scene.spec import BodySpec, SceneSpec
from guard_api.shapes import Mesh
from guard_bullet.dominance import NEGLIGIBLE, can_touch, geared_joints
from guard_bullet.engine import Client, connect, disconnect, pybullet, solve_directly
from guard_bullet.massless import TOKEN, token_links
from guard_bullet.pairs import self_collides
from guard_bullet.robot import BASE, NO_ROBOT, build_robot, neutralise
from guard_bullet.rotors import build_rotors
from guard_bullet.shapes import body_collision, body_frame, collision_shape, xyzw
from guard_bullet.surfaces import Surfaces, surfaces
from guard_bullet.surfaces import approximations as surface_approximations

SCATTER = 1000.0
"""Distance between things in the pristine state [m]."""

HULL_MARGIN = 0.001
"""How far the engine inflates convex hulls [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instance:
    """One world's engine instance.

    robot: the engine's number of the robot, NO_ROBOT without one; joints: its indices of the robot's joints, in order.
    rotors: its number of the rotors' wheels, NO_ROBOT without any.
    bodies: its numbers of the bodies, in the scene's order.
    pristine: the engine's number of the state right after building, without any contact or history.
    """

    client: Client
    pristine: int
    robot: int
    joints: list[int]
    rotors: int
    bodies: tuple[int, ...]


def build_instance(scene: SceneSpec) -> Instance:
    """Return a new engine instance with `scene` in it, everything at the origin.

    Raises BackendError for what the engine cannot build; nothing is left behind then.
    """
    client = connect(scene)
    try:
        if scene.robot and geared_joints(scene, scene.robot):
            solve_directly(client)
        surface = surfaces(scene)
        ground = _build_ground(client, surface) if scene.ground else None
        robot = build_robot(client, scene.robot, surface) if scene.robot else NO_ROBOT
        rotors = build_rotors(client, scene, scene.robot, robot) if scene.robot else NO_ROBOT
        bodies = tuple(_build_body(client, body, surface) for body in scene.bodies)
        if scene.preset == "rigid":
            _let_bounce(client, scene, bodies)
        if scene.robot and ground is not None and not scene.robot.collide_ground:
            for index in range(BASE, len(scene.robot.joints)):
                pybullet.setCollisionFilterPair(robot, ground, index, BASE, 0, physicsClientId=client)
    except pybullet.error as problem:
        disconnect(client)
        raise BackendError(f"bullet: the engine cannot build the scene: {problem}") from problem
    except BaseException:
        disconnect(client)
        raise
    _scatter(client, [*([robot] if scene.robot else []), *bodies])
    joints = list(range(len(scene.robot.joints))) if scene.robot else []
    pristine = pybullet.saveState(client)
    return Instance(client=client, pristine=pristine, robot=robot, joints=joints, rotors=rotors, bodies=bodies)


def forget(instance: Instance) -> None:
    """Return an engine instance to its pristine state.

    Restoring alone leaves contacts of before in the engine's caches, which then start the solver; looking for contacts
    while nothing is near anything else drops them.
    """
    pybullet.restoreState(stateId=instance.pristine, physicsClientId=instance.client)
    pybullet.performCollisionDetection(physicsClientId=instance.client)


def _let_bounce(client: Client, scene: SceneSpec, bodies: tuple[int, ...]) -> None:
    """Let contacts of bouncing bodies act only once they touch.

    The engine otherwise brakes an approaching body a step early, so that it arrives at the surface too slow to bounce.
    """
    for spec, body in zip(scene.bodies, bodies, strict=True):
        if spec.physics == "dynamic" and spec.restitution > 0.0:
            pybullet.changeDynamics(body, BASE, contactProcessingThreshold=0.0, physicsClientId=client)


def _scatter(client: Client, bodies: list[int]) -> None:
    """Move every body high up and away from the others, where no two shapes are near each other."""
    for number, body in enumerate(bodies, start=1):
        place = [0.0, 0.0, SCATTER * number]
        pybullet.resetBasePositionAndOrientation(body, place, [0.0, 0.0, 0.0, 1.0], physicsClientId=client)


def approximations(scene: SceneSpec) -> tuple[str, ...]:
    """Return what of `scene` this engine does not express exactly, one sentence each."""
    armature, massless = _armature_approximations(scene), _massless_approximations(scene)
    return (*surface_approximations(scene), *_shape_approximations(scene), *armature, *massless)


def _build_ground(client: Client, surface: Surfaces) -> int:
    shape = pybullet.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=[0.0, 0.0, 1.0], physicsClientId=client)
    ground = pybullet.createMultiBody(0.0, shape, physicsClientId=client)
    neutralise(client, ground, BASE, friction=surface.friction, restitution=surface.restitution)
    return ground


def _build_body(client: Client, spec: BodySpec, surface: Surfaces) -> int:
    if spec.physics == "phantom":
        raise BackendError("bullet: a phantom body reached the physics; phantoms belong to the environment")
    moves = spec.physics == "dynamic"
    frame = body_frame(spec.shape)
    body = pybullet.createMultiBody(
        baseMass=spec.mass if moves else 0.0,
        baseCollisionShapeIndex=collision_shape(client, [body_collision(spec.shape)]),
        baseInertialFrameOrientation=xyzw(frame.quaternion),
        physicsClientId=client,
    )
    if body < 0:
        raise BackendError(f"bullet: the engine refused a {spec.physics} body of shape {spec.shape}")
    if moves:
        inertia = [spec.mass * moment for moment in frame.moments]
        pybullet.changeDynamics(body, BASE, localInertiaDiagonal=inertia, physicsClientId=client)
    friction, restitution = surface.friction, surface.restitution
    if moves:
        friction, restitution = surface.of_mover(spec.friction, spec.restitution)
    neutralise(client, body, BASE, friction=friction, restitution=restitution)
    return body


def _armature_approximations(scene: SceneSpec) -> Iterator[str]:
    robot = scene.robot
    if robot is None or not can_touch(scene, robot):
        return
    geared = geared_joints(scene, robot)
    if geared and self_collides(robot):
        yield "contacts among the robot's own links are coupled to its others in part only (Bullet's direct solver)"
    names = [j.name for i, j in enumerate(robot.joints) if i not in geared and (j.armature > 0.0 or j.damping > 0.0)]
    if names:
        share = f"less than {NEGLIGIBLE:.0%} of the inertia that they move"
        yield f"contacts and stops feel joints {', '.join(names)} without their armature and implicit damping, {share}"


def _massless_approximations(scene: SceneSpec) -> Iterator[str]:
    names = token_links(scene.robot) if scene.robot else []
    if names:
        share = f"{TOKEN:g} of the robot's mass and of its largest moment of inertia"
        yield f"massless links {', '.join(names)} have {share}, since their joints can fall in line with others"


def _shape_approximations(scene: SceneSpec) -> Iterator[str]:
    links = scene.robot.links if scene.robot else ()
    for link in links:
        values = sorted({collision.friction for collision in link.collisions})
        if len(values) > 1:
            yield f"link {link.name!r} has friction {values[-1]:g} on all its shapes (Bullet: one a link), not {values}"
    hulls = [f"link {link.name!r}" for link in links if any(isinstance(c.shape, Mesh) for c in link.collisions)]
    hulls += [f"group {group.name!r}" for group in scene.groups if isinstance(group.body.shape, Mesh)]
    if hulls:
        yield f"convex hulls are inflated by {1e3 * HULL_MARGIN:g} mm: {', '.join(hulls)}"
