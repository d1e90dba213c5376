"""Joint damping and armature as GUARD defines them, for an engine with explicit damping and no armature.

With D the dampings, A the armatures, h the timestep and M the engine's own mass matrix, the acceleration that the law
asks for is that of (M + A + h D) a = effort - D qd - bias. The engine solves M a = torque - bias; the torque with which
it arrives at the same a is

    torque = effort - D (qd + h a) - A a.

It is exact as long as nothing but the actuators acts on the robot. What a contact or a joint stop adds within a substep
feels armature and implicit damping through the wheels of `guard_bullet.rotors`.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from guard_api.model.dynamics import Dynamics
from guard_api.model.robot import PLANAR_JOINTS, RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_api.scene.spec import SceneSpec
from guard_api.shapes import IDENTITY
from guard_bullet.compile import Instance
from guard_bullet.equations import EngineDynamics
from guard_bullet.motion import RobotMotion

Array = NDArray[np.float64]


_WORLD_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Accelerations(Protocol):
    """Computes the joint accelerations that the law asks for."""

    def __call__(self, instances: list[Instance], motion: RobotMotion, effort: Array, thrust: Array) -> Array:
        """Return a (N, J) from efforts (N, J) and thrusts (N, T, 3) in link axes."""
        ...


class PassiveLaw:
    """Turns the actuators' efforts into the torques that the engine must be given."""

    def __init__(self, scene: SceneSpec, robot: RobotModel) -> None:
        self.damping = np.array([joint.damping for joint in robot.joints])
        self.armature = np.array([joint.armature for joint in robot.joints])
        self.timestep = scene.timestep
        self.accelerations = _accelerations(scene, robot) if self.damping.any() or self.armature.any() else None

    @property
    def needs_base(self) -> bool:
        """Whether the base's motion must be known at every substep."""
        return self.accelerations is not None

    @property
    def carries_thrust(self) -> bool:
        """Whether `torque` contains what the thrusters do, so that the engine must not be told of them again."""
        return isinstance(self.accelerations, PlanarBody)

    def torque(
        self, instances: list[Instance], motion: RobotMotion, effort: Array, thrust: Array
    ) -> tuple[Array, Array | None]:
        """Return the torques (N, J) to send for `effort` (N, J) and `thrust` (N, T, 3).

        With them the joint accelerations (N, J) that the law asks for; None where it adds nothing to the efforts.
        """
        if self.accelerations is None:
            return effort, None
        if isinstance(self.accelerations, PlanarBody):
            effort = effort + self.accelerations.thrust_effort(motion, thrust)
        a = self.accelerations(instances, motion, effort, thrust)
        return effort - self.damping * (motion.qd + self.timestep * a) - self.armature * a, a


class PlanarBody:
    """One rigid body on a planar base: mass matrix and bias are closed forms of the heading alone."""

    def __init__(self, scene: SceneSpec, robot: RobotModel) -> None:
        law, body = ActuationLaw(robot), robot.links[-1]
        self._com = np.array(body.com[:2])
        self._mass = body.mass
        self._spin = body.inertia[2][2] + body.mass * float(self._com @ self._com)
        self._points = law.thrust_point[:, :2]
        self._gravity = np.array([*scene.gravity[:2]])
        self._damping = np.array([joint.damping for joint in robot.joints])
        extra = [joint.armature + scene.timestep * joint.damping for joint in robot.joints]
        self._diagonal = np.array([self._mass, self._mass, self._spin]) + extra

    @staticmethod
    def fits(robot: RobotModel) -> bool:
        """Return whether `robot` is such a body, its base joints plain x, y and yaw."""
        plain = all(
            (joint.name, joint.axis, joint.origin.quaternion) == (name, axis, IDENTITY)
            for joint, name, axis in zip(robot.joints, PLANAR_JOINTS, _WORLD_AXES, strict=False)
        )
        carriers = all(link.mass == 0.0 for link in robot.links[1:3])
        offsets = all(joint.origin.position[:2] == (0.0, 0.0) for joint in robot.joints[1:])
        return robot.base == "planar" and len(robot.joints) == 3 and plain and carriers and offsets

    def thrust_effort(self, motion: RobotMotion, thrust: Array) -> Array:
        """Return what the thrusts (N, T, 3) amount to on the three joints: (N, 3)."""
        effort = np.zeros_like(motion.q)
        yaw = np.ascontiguousarray(motion.q[:, 2])
        cos, sin = np.cos(yaw), np.sin(yaw)
        for k, (x, y) in enumerate(self._points.tolist()):
            fx, fy = thrust[:, k, 0], thrust[:, k, 1]
            effort[:, 0] += cos * fx - sin * fy
            effort[:, 1] += sin * fx + cos * fy
            effort[:, 2] += x * fy - y * fx
        return effort

    def __call__(self, instances: list[Instance], motion: RobotMotion, effort: Array, thrust: Array) -> Array:
        """Solve the 3 x 3 system by elimination of x and y, whose block is diagonal; `effort` contains the thrust."""
        del instances, thrust
        yaw, rate = np.ascontiguousarray(motion.q[:, 2]), motion.qd[:, 2]
        cos, sin = np.cos(yaw), np.sin(yaw)
        lever_x, lever_y = cos * self._com[0] - sin * self._com[1], sin * self._com[0] + cos * self._com[1]
        force = effort - self._damping * motion.qd
        mx, my = self._mass * lever_x, self._mass * lever_y
        force[:, 0] += mx * rate * rate + self._mass * self._gravity[0]
        force[:, 1] += my * rate * rate + self._mass * self._gravity[1]
        force[:, 2] += mx * self._gravity[1] - my * self._gravity[0]
        dx, dy, dz = self._diagonal
        a = np.empty_like(force)
        spin = dz - my * my / dx - mx * mx / dy
        a[:, 2] = (force[:, 2] + my * force[:, 0] / dx - mx * force[:, 1] / dy) / spin
        a[:, 0] = (force[:, 0] + my * a[:, 2]) / dx
        a[:, 1] = (force[:, 1] - mx * a[:, 2]) / dy
        return a


class EngineSolution:
    """The engine's mass matrix and bias force, world by world; the systems solved for all worlds together."""

    def __init__(self, scene: SceneSpec, robot: RobotModel) -> None:
        self._equations = EngineDynamics(scene, robot)
        self._damping = np.array([joint.damping for joint in robot.joints])
        extra = np.zeros(self._equations.num_coordinates)
        self._joints = slice(len(extra) - len(robot.joints), None)
        extra[self._joints] = [joint.armature + scene.timestep * joint.damping for joint in robot.joints]
        self._extra = np.diag(extra)

    def __call__(self, instances: list[Instance], motion: RobotMotion, effort: Array, thrust: Array) -> Array:
        """Solve (M + A + h D) a = effort - D qd - bias, the base's rows included."""
        del thrust
        matrix, bias = self._equations(instances, motion)
        right = -bias
        right[:, self._joints] += effort - self._damping * motion.qd
        solution = np.linalg.solve(matrix + self._extra, right[:, :, None])
        return np.asarray(solution[:, self._joints, 0], np.float64)


class NeutralDynamics:
    """The neutral layer's equations of motion: for robots with thrusters as well as damping or armature."""

    def __init__(self, scene: SceneSpec, robot: RobotModel) -> None:
        self._dynamics = Dynamics(robot, scene.gravity)
        self._timestep = scene.timestep
        self._joints = slice(6, None) if robot.floating else slice(None)

    def __call__(self, instances: list[Instance], motion: RobotMotion, effort: Array, thrust: Array) -> Array:
        """Return the joints' part of the neutral acceleration."""
        del instances
        poses = self._dynamics.kinematics.poses(motion.base_position, motion.base_quaternion, motion.q)
        a = self._dynamics.acceleration(
            poses, motion.base_linear, motion.base_angular, motion.qd, effort=effort, thrust=thrust,
            timestep=self._timestep,
        )  # fmt: skip
        return a[:, self._joints]


def _accelerations(scene: SceneSpec, robot: RobotModel) -> Accelerations:
    if PlanarBody.fits(robot):
        return PlanarBody(scene, robot)
    if any(actuator.law == "thrust" for actuator in robot.actuators):
        return NeutralDynamics(scene, robot)
    return EngineSolution(scene, robot)
