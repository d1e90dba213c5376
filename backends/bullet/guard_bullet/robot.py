"""A `RobotModel` as one articulated body of the engine, with every default that would change it neutralised."""

from __future__ import annotations

from guard_api.errors import BackendError
from guard_api.model.robot import Joint, RobotModel
from guard_api.shapes import IDENTITY
from guard_bullet.engine import Client, pybullet
from guard_bullet.massless import held_links
from guard_bullet.pairs import connected, self_collides
from guard_bullet.shapes import Principal, collision_shape, principal, xyzw
from guard_bullet.surfaces import ROBOT_RESTITUTION, Surfaces, link_friction

NO_ROBOT = -1
BASE = -1
"""The engine's index of a body's first link; model link i has index i - 1."""

NO_SPEED_LIMIT = 1e30
MAX_DOFS = 128


def build_robot(client: Client, robot: RobotModel, surfaces: Surfaces) -> int:
    """Create `robot` at the origin in `client` and return its body number; joint i of the model has index i.

    Raises BackendError for what the engine cannot hold.
    """
    if len(robot.joints) > MAX_DOFS - 6:
        raise BackendError(
            f"bullet: robot {robot.name!r} has {len(robot.joints)} joints, the engine holds {MAX_DOFS - 6}"
        )
    base, *links = held_links(robot)
    frames = [base_frame(robot), *(principal(link.inertia) for link in links)]
    flags = pybullet.URDF_MAINTAIN_LINK_ORDER | (pybullet.URDF_USE_SELF_COLLISION if self_collides(robot) else 0)
    body = pybullet.createMultiBody(
        baseMass=base.mass if robot.floating else 0.0,  # mass 0 is how the engine welds a base to the world
        baseCollisionShapeIndex=collision_shape(client, base.collisions),
        baseInertialFramePosition=base.com if robot.floating else (0.0, 0.0, 0.0),
        baseInertialFrameOrientation=xyzw(frames[0].quaternion),
        linkMasses=[link.mass for link in links],
        linkCollisionShapeIndices=[collision_shape(client, link.collisions) for link in links],
        linkVisualShapeIndices=[-1] * len(links),
        linkPositions=[list(joint.origin.position) for joint in robot.joints],
        linkOrientations=[xyzw(joint.origin.quaternion) for joint in robot.joints],
        linkInertialFramePositions=[list(link.com) for link in links],
        linkInertialFrameOrientations=[xyzw(frame.quaternion) for frame in frames[1:]],
        linkParentIndices=[robot.link_index(joint.parent) for joint in robot.joints],
        linkJointTypes=[_joint_type(joint) for joint in robot.joints],
        linkJointAxis=[list(joint.axis) for joint in robot.joints],
        flags=flags,
        physicsClientId=client,
    )
    if body < 0:
        raise BackendError(f"bullet: the engine refused robot {robot.name!r}")
    for index, (link, frame) in enumerate(zip((base, *links), frames, strict=True), start=BASE):
        if index != BASE or robot.floating:
            pybullet.changeDynamics(body, index, localInertiaDiagonal=frame.moments, physicsClientId=client)
        friction, restitution = surfaces.of_mover(link_friction(link), ROBOT_RESTITUTION)
        neutralise(client, body, index, friction=friction, restitution=restitution)
    _set_joints(client, body, robot)
    _filter_neighbours(client, body, robot)
    return body


def base_frame(robot: RobotModel) -> Principal:
    """Return the axes in which the engine holds the base: principal ones if it floats, else those of its link."""
    if robot.floating:
        return principal(robot.links[0].inertia)
    return Principal(moments=(0.0, 0.0, 0.0), quaternion=IDENTITY)


def neutralise(client: Client, body: int, index: int, *, friction: float, restitution: float) -> None:
    """Set a link's surface and switch off damping, rolling and spinning friction, speed limit and sleeping.

    One keyword per call: the engine loses some when several are given.
    """
    settings = {
        "lateralFriction": friction,
        "restitution": restitution,
        "rollingFriction": 0.0,
        "spinningFriction": 0.0,
        "linearDamping": 0.0,
        "angularDamping": 0.0,
        "jointDamping": 0.0,
        "maxJointVelocity": NO_SPEED_LIMIT,
        "activationState": pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
    }
    for name, value in settings.items():
        pybullet.changeDynamics(body, index, **{name: value}, physicsClientId=client)


def _set_joints(client: Client, body: int, robot: RobotModel) -> None:
    for index, joint in enumerate(robot.joints):
        if joint.limits is not None:
            lower, upper = joint.limits
            pybullet.changeDynamics(body, index, jointLowerLimit=lower, jointUpperLimit=upper, physicsClientId=client)
        # The engine brakes every joint by a velocity motor at rest; with the joint's dry friction as its strength, that
        # motor is Coulomb friction, and with strength 0 it is off.
        pybullet.setJointMotorControl2(
            body, index, pybullet.VELOCITY_CONTROL, targetVelocity=0.0, force=joint.friction_loss,
            physicsClientId=client,
        )  # fmt: skip


def _filter_neighbours(client: Client, body: int, robot: RobotModel) -> None:
    for pair in connected(robot):
        a, b = sorted(pair)
        pybullet.setCollisionFilterPair(body, body, a + BASE, b + BASE, 0, physicsClientId=client)


def _joint_type(joint: Joint) -> int:
    return pybullet.JOINT_PRISMATIC if joint.kind == "prismatic" else pybullet.JOINT_REVOLUTE
