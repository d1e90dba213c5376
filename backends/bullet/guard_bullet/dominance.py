"""Which joints have a rotor that outweighs everything they can move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import RobotModel

Array = NDArray[np.float64]

DOMINANCE = 2.0
"""By how much the armature must exceed the inertia of the whole robot about the joint."""


def rotor_joints(robot: RobotModel) -> list[int]:
    """Return the joints whose armature is more than `DOMINANCE` times all the inertia that it could have to turn."""
    if any(actuator.law == "thrust" for actuator in robot.actuators):
        return []
    inertia = _whole_robot_about_joints(robot)
    return [i for i, joint in enumerate(robot.joints) if joint.armature > DOMINANCE * inertia[i]]


def _whole_robot_about_joints(robot: RobotModel) -> Array:
    """Return (J,) the mass, or the inertia about each hinge's axis, of all links together in the home pose."""
    q = np.array([[robot.home.joint_position.get(joint.name, 0.0) for joint in robot.joints]])
    poses = Kinematics(robot).poses(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), q)
    links = list(zip(robot.links, poses.position[0], poses.quaternion[0], strict=True))
    links = links if robot.floating else links[1:]
    result = np.zeros(len(robot.joints))
    for i, joint in enumerate(robot.joints):
        child = robot.link_index(joint.child)
        axis = rotations.rotate(poses.quaternion[0, child], np.array(joint.axis))
        for link, position, quaternion in links:
            if joint.kind == "prismatic":
                result[i] += link.mass
                continue
            arm = position + rotations.rotate(quaternion, np.array(link.com)) - poses.position[0, child]
            off = rotations.cross(axis, arm)
            local = rotations.unrotate(quaternion, axis)
            result[i] += link.mass * float(off @ off) + float(local @ np.array(link.inertia) @ local)
    return result
