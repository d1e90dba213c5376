"""How much inertia the armature and the implicit damping of a joint add to what the joint moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import RobotModel
from guard_api.scene.spec import SceneSpec
from guard_bullet.pairs import self_collides

Array = NDArray[np.float64]

NEGLIGIBLE = 0.01
"""Share of the inertia that a joint moves below which what its armature adds is left to the torque law alone."""

TOKEN = 1e-3
"""Smallest rotor, in shares of the inertia that the joint moves: the solver needs some."""


def rotor_inertias(scene: SceneSpec, robot: RobotModel) -> Array:
    """Return (J,) inertia of the rotor, armature + timestep x damping, of the joints that get one, 0 for the others.

    A rotor is worth its cost where something besides the actuators acts on the robot: contacts, stops or dry friction.
    """
    added = np.array([joint.armature + scene.timestep * joint.damping for joint in robot.joints])
    bound = any(joint.limits is not None or joint.friction_loss > 0.0 for joint in robot.joints)
    if not added.any() or not (bound or can_touch(scene, robot)):
        return np.zeros(len(robot.joints))
    carried = _carried(robot)
    matters = added > NEGLIGIBLE * carried
    # Where there are rotors, every joint stop needs one (see `guard_bullet.rotors`), if only a token.
    stopped = np.array([joint.limits is not None for joint in robot.joints]) & matters.any()
    return np.where(matters | stopped, np.maximum(added, TOKEN * carried), 0.0)


def geared_joints(scene: SceneSpec, robot: RobotModel) -> list[int]:
    """Return the joints that have a rotor; wheel k of `guard_bullet.rotors` belongs to the k-th of them."""
    return [i for i, inertia in enumerate(rotor_inertias(scene, robot)) if inertia > 0.0]


def can_touch(scene: SceneSpec, robot: RobotModel) -> bool:
    """Return whether any shape of the robot can ever touch anything in this scene."""
    if not any(link.collisions for link in robot.links):
        return False
    return scene.num_bodies > 0 or (scene.ground and robot.collide_ground) or self_collides(robot)


def _carried(robot: RobotModel) -> Array:
    """Return (J,) the mass, or the inertia about each hinge's axis, of all links beyond the joint, at home."""
    q = np.array([[robot.home.joint_position.get(joint.name, 0.0) for joint in robot.joints]])
    poses = Kinematics(robot).poses(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), q)
    position, quaternion = poses.position[0], poses.quaternion[0]
    result = np.zeros(len(robot.joints))
    parent = {joint.child: joint for joint in robot.joints}
    index = {joint.name: i for i, joint in enumerate(robot.joints)}
    for number, link in enumerate(robot.links):
        com = position[number] + rotations.rotate(quaternion[number], np.array(link.com))
        inertia = np.array(link.inertia)
        above = parent.get(link.name)
        while above is not None:
            child = robot.link_index(above.child)
            axis = rotations.rotate(quaternion[child], np.array(above.axis))
            if above.kind == "prismatic":
                result[index[above.name]] += link.mass
            else:
                off, local = np.cross(axis, com - position[child]), rotations.unrotate(quaternion[number], axis)
                result[index[above.name]] += link.mass * float(off @ off) + float(local @ inertia @ local)
            above = parent.get(above.parent)
    return result
