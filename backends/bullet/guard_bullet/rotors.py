"""Armature that contacts feel: joints whose rotor outweighs everything the joint can move.

The torque of `guard_bullet.passive` gives such a joint the right acceleration only while nothing touches the robot: the
engine's link alone would answer a contact, a thousand times lighter than link and rotor together. Here the rotor leads:
each substep its velocity is computed with the armature, and a velocity motor of the engine makes the joint follow it,
whatever touches the robot. What the contacts did to the robot is measured after every substep,

    g = M (u' - u) / h + bias - torque,

(u: all velocities, torque: commanded and motor's) and acts on the rotors in the next one: momentum is conserved, a
substep late. That delay is stable while the inertia behind the contact is smaller than the armature, which is the
condition for treating a joint this way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.scene.spec import SceneSpec
from guard_bullet.dominance import rotor_joints
from guard_bullet.equations import EngineDynamics
from guard_bullet.motion import RobotMotion

Array = NDArray[np.float64]

STRENGTH = 1e9
"""Torque that the motors may use [N m] or [N]: no limit in practice."""


class Rotors:
    """The rotors of `joints` in N worlds, and the contact forces that they have yet to feel.

    reaction: (N, D) generalised force of contacts and joint stops in the last substep, engine coordinates.
    """

    def __init__(self, scene: SceneSpec, robot: RobotModel, num_worlds: int) -> None:
        self.joints = rotor_joints(robot)
        self.strengths = [STRENGTH] * len(self.joints)
        self._timestep = scene.timestep
        self._equations = EngineDynamics(scene, robot)
        self._num_base = self._equations.num_coordinates - len(robot.joints)
        self.reaction = np.zeros((num_worlds, self._equations.num_coordinates))
        limits = [robot.joints[j].limits or (-np.inf, np.inf) for j in self.joints]
        self._lower, self._upper = np.array(limits).reshape(-1, 2).T
        self._friction = np.array([robot.joints[j].friction_loss for j in self.joints])
        self._inertia = np.array([robot.joints[j].armature for j in self.joints])

    def targets(self, motion: RobotMotion, acceleration: Array) -> Array:
        """Return the rotors' velocities (N, R) at the end of the substep; they stop at the joints' limits."""
        q, qd = motion.q[:, self.joints], motion.qd[:, self.joints]
        velocity = qd + self._timestep * acceleration[:, self.joints]
        grip = self._timestep * self._friction / self._inertia
        velocity -= np.clip(velocity, -grip, grip)
        room = np.minimum(self._lower - q, 0.0) / self._timestep, np.maximum(self._upper - q, 0.0) / self._timestep
        return np.clip(velocity, *room)

    def observe(
        self, worlds: list[int], before: RobotMotion, after: RobotMotion, terms: tuple[Array, Array], torque: Array
    ) -> None:
        """Take from the substep of `worlds` what pushed the robot beside `torque` (N, J).

        terms: mass matrix (N, D, D) and bias (N, D) `before` it.
        """
        matrix, bias = terms
        change = np.zeros_like(self.reaction)
        change[:, self._num_base :] = after.qd - before.qd
        if self._num_base:
            _, axes, linear, angular = before.engine_base()
            _, _, linear_after, angular_after = after.engine_base()
            change[:, 0:3] = rotations.unrotate(axes, angular_after - angular)
            change[:, 3:6] = rotations.unrotate(axes, linear_after - linear)
        force = np.add.reduce(matrix * change[:, None, :], axis=2) / self._timestep + bias
        force[:, self._num_base :] -= torque
        self.reaction[worlds] = force[worlds]
