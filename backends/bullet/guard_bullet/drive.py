"""The robot's actuation in all worlds: from controls to the torques and forces that the engine is given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_api.scene.spec import SceneSpec
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet
from guard_bullet.motion import FIELDS, RobotMotion
from guard_bullet.passive import PassiveLaw
from guard_bullet.robot import BASE
from guard_bullet.shapes import principal

Array = NDArray[np.float64]


class RobotDrive:
    """The actuation law of one robot in N worlds, together with the motion that it acts on.

    effort: (N, J) actuator effort in the last substep. geared: (N, U) of the last command.
    """

    def __init__(self, scene: SceneSpec, robot: RobotModel, num_worlds: int) -> None:
        self.motion = RobotMotion(robot, num_worlds)
        self.law = ActuationLaw(robot)
        self.passive = PassiveLaw(scene, robot)
        self.effort = np.zeros((num_worlds, len(robot.joints)))
        self.geared = np.zeros((num_worlds, self.law.num_controls))
        self._thrust = self.law.thrust(self.geared)
        # The engine takes a force in the principal axes of the link that it pulls, at a point seen from the com.
        pulled = [robot.links[index] for index in self.law.thrust_link]
        axes = np.array([principal(link.inertia).quaternion for link in pulled]).reshape(-1, 4)
        coms = np.array([link.com for link in pulled]).reshape(-1, 3)
        self._thrust_axes = axes
        self._thrust_points = rotations.unrotate(axes, self.law.thrust_point - coms).tolist()
        self._thrust_links = [int(index) + BASE for index in self.law.thrust_link]
        self._pulls = bool(self._thrust_links) and not self.passive.carries_thrust
        self._engine_thrust: list[list[list[float]]] = []
        self.command(np.zeros_like(self.geared))

    def command(self, control: NDArray[np.floating]) -> None:
        """Hold `control` (N, U) from now on."""
        self.geared = self.law.geared(control)
        self._thrust = self.law.thrust(self.geared)
        if self._pulls:
            self._engine_thrust = rotations.unrotate(self._thrust_axes, self._thrust).tolist()

    def torque(self, worlds: list[int], instances: list[Instance]) -> Array:
        """Return the joint torques (N, J) to send for the present motion, and note the efforts of `worlds`."""
        effort = self.law.joint_effort(self.geared, self.motion.q, self.motion.qd)
        self.effort[worlds] = effort[worlds]
        return self.passive.torque(instances, self.motion, effort, self._thrust)

    def advance(self, worlds: list[int], instances: list[Instance]) -> NDArray[np.bool_]:
        """Evaluate the law and let the engine make one substep in `worlds`; `instances` are all N engine instances.

        Returns (N,) whether a world could be stepped: one whose torques are not finite stays as it is.
        """
        torque = self.torque(worlds, instances)
        finite = np.logical_and.reduce(np.isfinite(torque), axis=1)
        set_torques, step, mode = pybullet.setJointMotorControlArray, pybullet.stepSimulation, pybullet.TORQUE_CONTROL
        rows = torque.tolist()
        for world in worlds:
            if not finite[world]:
                continue
            instance, efforts = instances[world], rows[world]
            client = instance.client
            if efforts:
                set_torques(instance.robot, instance.joints, mode, forces=efforts, physicsClientId=client)
            if self._pulls:
                self._pull(world, instance)
            step(client)
        return finite

    def read(self, worlds: list[int], instances: list[Instance]) -> None:
        """Fetch what the law needs for the next substep of `worlds`."""
        self.motion.read_joints(worlds, instances)
        if self.passive.needs_base:
            self.motion.read_base(worlds, instances)

    def _pull(self, world: int, instance: Instance) -> None:
        """Let the thrusters of world number `world` pull in its engine instance, for one substep."""
        forces = self._engine_thrust[world]
        for link, point, force in zip(self._thrust_links, self._thrust_points, forces, strict=True):
            pybullet.applyExternalForce(
                instance.robot, link, force, point, pybullet.LINK_FRAME, physicsClientId=instance.client
            )

    def clear(self, mask: NDArray[np.bool_]) -> None:
        """Forget the last efforts and controls of the worlds where `mask` is true."""
        self.effort[mask] = 0.0

    def arrays(self) -> dict[str, Array]:
        """Return what a snapshot keeps, by name."""
        return {name: getattr(self.motion, name) for name in FIELDS} | {"effort": self.effort}
