"""The robot's actuation in all worlds: from controls to the torques and forces that the engine is given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_api.scene.spec import SceneSpec
from guard_bullet.compile import Instance
from guard_bullet.dominance import geared_joints, rotor_inertias
from guard_bullet.engine import pybullet
from guard_bullet.motion import FIELDS, RobotMotion
from guard_bullet.passive import PassiveLaw
from guard_bullet.robot import BASE
from guard_bullet.shapes import principal

Array = NDArray[np.float64]


class RobotDrive:
    """The actuation law of one robot in N worlds, together with the motion that it acts on.

    effort: (N, J) actuator effort in the last substep.
    """

    def __init__(self, scene: SceneSpec, robot: RobotModel, num_worlds: int) -> None:
        self.motion = RobotMotion(robot, num_worlds)
        self.law = ActuationLaw(robot)
        self.passive = PassiveLaw(scene, robot)
        self._geared_joints = geared_joints(scene, robot)
        self._wheels = list(range(len(self._geared_joints)))
        self._wheel_inertia = rotor_inertias(scene, robot)[self._geared_joints]
        self.effort = np.zeros((num_worlds, len(robot.joints)))
        self._geared = np.zeros((num_worlds, self.law.num_controls))
        self._thrust = self.law.thrust(self._geared)
        # The engine takes a force in the principal axes of the link that it pulls, at a point seen from the com.
        pulled = [robot.links[index] for index in self.law.thrust_link]
        self._thrust_axes = np.array([principal(link.inertia).quaternion for link in pulled]).reshape(-1, 4)
        coms = np.array([link.com for link in pulled]).reshape(-1, 3)
        self._thrust_points = rotations.unrotate(self._thrust_axes, self.law.thrust_point - coms).tolist()
        self._thrust_links = [int(index) + BASE for index in self.law.thrust_link]
        self._pulls = bool(self._thrust_links) and not self.passive.carries_thrust
        self._engine_thrust: list[list[list[float]]] = []
        self._kinematics = Kinematics(robot) if self.law.has_ceilings else None
        self.command(np.zeros_like(self._geared))

    def command(self, control: NDArray[np.floating]) -> None:
        """Hold `control` (N, U) from now on."""
        self._geared = self.law.geared(control)
        self._thrust = self.law.thrust(self._geared, self._thrust_heights())
        if self._pulls:
            self._engine_thrust = rotations.unrotate(self._thrust_axes, self._thrust).tolist()

    def advance(self, worlds: list[int], instances: list[Instance]) -> NDArray[np.bool_]:
        """Evaluate the law, let the engine make one substep in `worlds` and fetch what the law needs for the next.

        instances: all N engine instances. Returns (N,) whether a world went on with sound numbers; one whose torques
        are not finite is not stepped.
        """
        motion = self.motion
        effort = self.law.joint_effort(self._geared, motion.q, motion.qd)
        self.effort[worlds] = effort[worlds]
        if self.law.has_springs:
            effort = effort + self.law.spring_effort(motion.q)
        torque, acceleration = self.passive.torque(instances, motion, effort, self._thrust)
        finite = np.logical_and.reduce(np.isfinite(torque), axis=1)
        worlds = worlds if finite.all() else [world for world in worlds if finite[world]]
        if self._wheels and acceleration is not None:
            self._turn_wheels(worlds, instances, acceleration)
        self._step(worlds, instances, torque)
        self._read(worlds, instances)
        return finite & motion.sound

    def write(self, world: int, instance: Instance) -> None:
        """Put world number `world` into its engine instance."""
        self.motion.write(world, instance)
        q, qd = self.motion.q[world, self._geared_joints], self.motion.qd[world, self._geared_joints]
        for wheel, (angle, speed) in enumerate(zip((-q).tolist(), (-qd).tolist(), strict=True)):
            pybullet.resetJointState(instance.rotors, wheel, angle, speed, physicsClientId=instance.client)

    def clear(self, mask: NDArray[np.bool_]) -> None:
        """Forget the last substep of the worlds where `mask` is true."""
        self.effort[mask] = 0.0

    def arrays(self) -> dict[str, Array]:
        """Return what a snapshot keeps, by name."""
        return {name: getattr(self.motion, name) for name in FIELDS} | {"effort": self.effort}

    def _turn_wheels(self, worlds: list[int], instances: list[Instance], acceleration: Array) -> None:
        """Give the rotors' wheels the torque with which they keep up with their joints, for one substep."""
        rows = (-self._wheel_inertia * acceleration[:, self._geared_joints]).tolist()
        for world in worlds:
            instance = instances[world]
            pybullet.setJointMotorControlArray(
                instance.rotors, self._wheels, pybullet.TORQUE_CONTROL, forces=rows[world],
                physicsClientId=instance.client,
            )  # fmt: skip

    def _step(self, worlds: list[int], instances: list[Instance], torque: Array) -> None:
        set_torques, step, mode = pybullet.setJointMotorControlArray, pybullet.stepSimulation, pybullet.TORQUE_CONTROL
        rows = torque.tolist()
        for world in worlds:
            instance, efforts = instances[world], rows[world]
            client = instance.client
            if efforts:
                set_torques(instance.robot, instance.joints, mode, forces=efforts, physicsClientId=client)
            if self._pulls:
                self._pull(world, instance)
            step(client)

    def _read(self, worlds: list[int], instances: list[Instance]) -> None:
        self.motion.read_joints(worlds, instances)
        if self.passive.needs_base:
            self.motion.read_base(worlds, instances)

    def _thrust_heights(self) -> Array | None:
        """Return the present heights (N, T) of the thrust links' origins if the law asks for them."""
        if self._kinematics is None:
            return None
        motion = self.motion
        poses = self._kinematics.poses(motion.base_position, motion.base_quaternion, motion.q)
        return poses.position[:, self.law.thrust_link, 2]

    def _pull(self, world: int, instance: Instance) -> None:
        """Let the thrusters of world number `world` pull in its engine instance, for one substep."""
        forces = self._engine_thrust[world]
        for link, point, force in zip(self._thrust_links, self._thrust_points, forces, strict=True):
            pybullet.applyExternalForce(
                instance.robot, link, force, point, pybullet.LINK_FRAME, physicsClientId=instance.client
            )
