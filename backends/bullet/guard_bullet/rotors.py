"""Armature and implicit damping that contacts, stops and dry friction feel: a geared rotor beside the joint.

The engine has no armature. A second articulated body has one hinge per joint, each with a wheel whose inertia about
the hinge is A + h D, on a base welded to the world; a gear makes the wheel turn at the joint's speed, the other way
round. The wheel's energy is (A + h D) qd^2 / 2 whatever the link does, and its reaction goes to the world: that is
armature, exactly, for every force that the engine's solver knows of.

The torques of `guard_bullet.passive` give joint and wheel the same acceleration as long as nothing else acts. Then the
gear carries nothing, and motion in the air stays exact to rounding; it carries no more than the wheels' share of
contacts.

The engine's direct solver has a fault: of two constraints it takes the coupling from the first one's first body alone,
and an upper joint stop has its force on the second, which is the same robot. So it would not see that an upper stop and
a gear hold the same joint. Lower stops are right: a joint's upper stop is the lower one of its wheel, which turns the
other way round.
"""

from __future__ import annotations

from guard_api.model.robot import RobotModel
from guard_api.scene.spec import SceneSpec
from guard_bullet.dominance import geared_joints, rotor_inertias
from guard_bullet.engine import Client, pybullet
from guard_bullet.robot import BASE, NO_ROBOT, neutralise

STRENGTH = 1e30
"""Force that a gear may use: no limit."""

FAR = 1e6
"""Where a stop is out of reach [rad] or [m]."""

_NO_TURN = [0.0, 0.0, 0.0, 1.0]


def build_rotors(client: Client, scene: SceneSpec, robot: RobotModel, body: int) -> int:
    """Create the wheels of `robot`, which is `body` in `client`, and return their body; NO_ROBOT if it needs none."""
    joints = geared_joints(scene, robot)
    if not joints:
        return NO_ROBOT
    count, inertia = len(joints), rotor_inertias(scene, robot)
    wheels = pybullet.createMultiBody(
        baseMass=0.0,
        linkMasses=[1.0] * count,
        linkCollisionShapeIndices=[-1] * count,
        linkVisualShapeIndices=[-1] * count,
        linkPositions=[[0.0, 0.0, 0.0]] * count,
        linkOrientations=[_NO_TURN] * count,
        linkInertialFramePositions=[[0.0, 0.0, 0.0]] * count,
        linkInertialFrameOrientations=[_NO_TURN] * count,
        linkParentIndices=[0] * count,
        linkJointTypes=[pybullet.JOINT_REVOLUTE] * count,
        linkJointAxis=[[0.0, 0.0, 1.0]] * count,
        physicsClientId=client,
    )
    neutralise(client, wheels, BASE, friction=0.0, restitution=0.0)
    for wheel, joint in enumerate(joints):
        pybullet.changeDynamics(wheels, wheel, localInertiaDiagonal=[float(inertia[joint])] * 3, physicsClientId=client)
        neutralise(client, wheels, wheel, friction=0.0, restitution=0.0)
        pybullet.setJointMotorControl2(
            wheels, wheel, pybullet.VELOCITY_CONTROL, targetVelocity=0.0, force=0.0, physicsClientId=client
        )
        gear = pybullet.createConstraint(
            body, joint, wheels, wheel, pybullet.JOINT_GEAR, [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0],
            physicsClientId=client,
        )  # fmt: skip
        # Speeds are coupled, not angles (erp 0): for those the engine looks at the wrong body.
        pybullet.changeConstraint(gear, gearRatio=1.0, maxForce=STRENGTH, erp=0.0, physicsClientId=client)
        _split_limits(client, body, joint, wheels, wheel, robot.joints[joint].limits)
    return wheels


def _split_limits(
    client: Client, body: int, joint: int, wheels: int, wheel: int, limits: tuple[float, float] | None
) -> None:
    """Leave the joint its lower stop and give its upper one to the wheel."""
    if limits is None:
        return
    lower, upper = limits
    pybullet.changeDynamics(body, joint, jointLowerLimit=lower, jointUpperLimit=FAR, physicsClientId=client)
    pybullet.changeDynamics(wheels, wheel, jointLowerLimit=-upper, jointUpperLimit=FAR, physicsClientId=client)
