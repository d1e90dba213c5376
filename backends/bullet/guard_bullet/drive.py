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
        self._engine_thrust: list[list[list[float]]] = []
        self.command(np.zeros_like(self.geared))

    def command(self, control: NDArray[np.floating]) -> None:
        """Hold `control` (N, U) from now on."""
        self.geared = self.law.geared(control)
        self._thrust = self.law.thrust(self.geared)
        self._engine_thrust = rotations.unrotate(self._thrust_axes, self._thrust).tolist()

    def torque(self, instances: list[Instance], worlds: list[int]) -> Array:
        """Return the joint torques (N, J) to send for the present motion, and note the efforts of `worlds`."""
        effort = self.law.joint_effort(self.geared, self.motion.q, self.motion.qd)
        self.effort[worlds] = effort[worlds]
        return self.passive.torque(instances, self.motion, effort, self._thrust)

    def push(self, world: int, instance: Instance) -> None:
        """Let the thrusters of world number `world` pull in its engine instance, for one substep."""
        robot, client = instance.robot, instance.client
        assert robot is not None
        forces = self._engine_thrust[world]
        for link, point, force in zip(self._thrust_links, self._thrust_points, forces, strict=True):
            pybullet.applyExternalForce(robot.body, link, force, point, pybullet.LINK_FRAME, physicsClientId=client)

    @property
    def thrusts(self) -> bool:
        """Whether the robot has thrusters at all."""
        return bool(self._thrust_links)

    def clear(self, mask: NDArray[np.bool_]) -> None:
        """Forget the last efforts and controls of the worlds where `mask` is true."""
        self.effort[mask] = 0.0

    def arrays(self) -> dict[str, Array]:
        """Return what a snapshot keeps, by name."""
        return {name: getattr(self.motion, name) for name in FIELDS} | {"effort": self.effort}
