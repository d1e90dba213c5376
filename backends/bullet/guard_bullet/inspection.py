"""What the engine holds of one world, in the neutral layer's terms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.physics.state import Inspection
from guard_api.scene.spec import SceneSpec
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet
from guard_bullet.equations import EngineDynamics
from guard_bullet.motion import RobotMotion
from guard_bullet.robot import BASE

Array = NDArray[np.float64]

_MASS, _MOMENTS, _COM, _AXES = 0, 2, 3, 4
"""Fields of the engine's dynamics info that are used."""


def inspect_instance(instance: Instance, world: int, scene: SceneSpec, motion: RobotMotion | None) -> Inspection:
    """Return masses, inertias, mass matrix and bias force of the engine instance of world number `world`."""
    bodies = [pybullet.getDynamicsInfo(body, BASE, physicsClientId=instance.client)[_MASS] for body in instance.bodies]
    body_mass = np.array(bodies, float)
    robot = scene.robot
    if robot is None or motion is None:
        empty = np.zeros((0, 3))
        return Inspection(link_mass=np.zeros(0), link_com=empty, link_inertia=np.zeros((0, 3, 3)), mass_matrix=None,
                          bias_force=None, body_mass=body_mass)  # fmt: skip
    mass, com, inertia = _link_inertias(instance, robot)
    matrix, bias = _equations_of_motion(instance, world, scene, robot, motion)
    return Inspection(
        link_mass=mass, link_com=com, link_inertia=inertia, mass_matrix=matrix, bias_force=bias, body_mass=body_mass
    )


def _link_inertias(instance: Instance, robot: RobotModel) -> tuple[Array, Array, Array]:
    """Return mass (L,), com (L, 3) and inertia (L, 3, 3); of a welded base the model's, since the engine holds none."""
    rows = [
        pybullet.getDynamicsInfo(instance.robot, index + BASE, physicsClientId=instance.client)
        for index in range(len(robot.links))
    ]
    turns = [rotations.to_matrix([row[_AXES][3], *row[_AXES][:3]]) for row in rows]
    mass = np.array([row[_MASS] for row in rows])
    com = np.array([row[_COM] for row in rows])
    inertia = np.array([R @ np.diag(row[_MOMENTS]) @ R.T for R, row in zip(turns, rows, strict=True)])
    if not robot.floating:
        base = robot.links[0]
        mass[0], com[0], inertia[0] = base.mass, base.com, base.inertia
    return mass, com, inertia


def _equations_of_motion(
    instance: Instance, world: int, scene: SceneSpec, robot: RobotModel, motion: RobotMotion
) -> tuple[Array, Array]:
    """Return M (D, D) with the armature that the plugin adds, and the bias (D,), in the neutral coordinates."""
    matrices, biases = EngineDynamics(scene, robot)([instance], motion.only(world))
    matrix, bias = matrices[0], biases[0]
    armature = [joint.armature for joint in robot.joints]
    if robot.floating:
        matrix, bias = _neutral_base(matrix, bias, world, motion)
        armature = [0.0] * 6 + armature
    return matrix + np.diag(armature), bias


def _neutral_base(matrix: Array, bias: Array, world: int, motion: RobotMotion) -> tuple[Array, Array]:
    """Move the base rows from (angular, linear) at the com in principal axes to (linear, angular) at the link frame."""
    position, quaternion, _, angular = (row[world] for row in motion.engine_base())
    R = rotations.to_matrix(quaternion)
    arm = position - motion.base_position[world]
    T = np.eye(len(bias))
    T[:6, :6] = 0.0
    T[:3, 3:6] = R.T
    T[3:6, :3] = R.T
    T[3:6, 3:6] = -R.T @ _skew(arm)
    # u_engine = T u, so its derivative is T a + drift with the drift below.
    drift = np.zeros(len(bias))
    drift[3:6] = R.T @ np.cross(angular, np.cross(angular, arm))
    return T.T @ matrix @ T, T.T @ (bias + matrix @ drift)


def _skew(v: Array) -> Array:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
