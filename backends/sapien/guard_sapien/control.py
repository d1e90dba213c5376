"""The actuation law on PhysX: read joints, set generalised forces and thrusts, once per substep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_sapien.articulation import Articulation

Array = NDArray[np.float64]


class RobotControl:
    """`ActuationLaw` over the articulations of all worlds, plus the explicit part -D qd of the joint dampings."""

    def __init__(self, robot: RobotModel, articulations: list[Articulation]) -> None:
        self.law = ActuationLaw(robot)
        self.num_joints = len(robot.joints)
        self._damping = np.array([joint.damping for joint in robot.joints])
        self._reads_position = any(actuator.law == "position" for actuator in robot.actuators)
        self._reads_velocity = bool(self._damping.any()) or any(
            a.law == "velocity" or (a.law == "position" and a.kd) for a in robot.actuators
        )
        self.bind(articulations)
        # PhysX numbers joints breadth-first. `of_model`[j] is the engine's number of model joint j.
        self.of_model = joint_order(robot, articulations[0])
        self._of_engine = np.argsort(self.of_model)
        self._thrust_links = np.unique(self.law.thrust_link)
        self._com = np.array([robot.links[i].com for i in self.law.thrust_link]).reshape(-1, 3)

    def bind(self, articulations: list[Articulation]) -> None:
        """Take the articulations of all worlds, again after one was rebuilt."""
        self._articulations = articulations
        self._get_position = [a.engine.get_qpos for a in articulations]
        self._get_velocity = [a.engine.get_qvel for a in articulations]
        self._set_force = [a.engine.set_qf for a in articulations]

    def wrenches(self, geared: Array) -> tuple[Array, Array]:
        """Return force (n, T, 3) [N] and torque about the com (n, T, 3) [N m] per thrust link, in link axes.

        Constant over the substeps of one step.
        """
        force = self.law.thrust(geared)
        torque = rotations.cross(self.law.thrust_point - self._com, force)
        on = [self.law.thrust_link == link for link in self._thrust_links]
        return np.stack([force[:, m].sum(1) for m in on], 1), np.stack([torque[:, m].sum(1) for m in on], 1)

    def apply(self, worlds: list[int], geared: Array, wrenches: tuple[Array, Array] | None) -> Array:
        """Set the forces of one substep in `worlds`; return the actuator effort on every joint: (n, J)."""
        if wrenches is not None:
            self._apply_thrust(worlds, *wrenches)
        if not self.num_joints:
            return np.zeros((len(worlds), 0))
        q = self._read(self._get_position, worlds, self._reads_position)
        qd = self._read(self._get_velocity, worlds, self._reads_velocity)
        effort = self.law.joint_effort(geared, q, qd)
        force = (effort - self._damping * qd).take(self._of_engine, axis=1).astype(np.float32)
        for world, row in zip(worlds, force):
            self._set_force[world](row)
        return effort

    @property
    def thrusts(self) -> bool:
        """Whether any actuator is a thrust."""
        return bool(self.law.on_link)

    def _read(self, getters: list, worlds: list[int], wanted: bool) -> Array:
        """Return joint positions or velocities (n, J) in the model's order, or zeros where no law looks at them."""
        if not wanted:
            return np.zeros((len(worlds), self.num_joints))
        rows = np.concatenate([getters[world]() for world in worlds]).reshape(len(worlds), -1)
        return rows.take(self.of_model, axis=1).astype(float)

    def _apply_thrust(self, worlds: list[int], force: Array, torque: Array) -> None:
        links = [[self._articulations[w].links[i] for i in self._thrust_links] for w in worlds]
        quaternion = np.array([[link.entity_pose.q for link in row] for row in links], float)
        force = rotations.rotate(quaternion, force).astype(np.float32)
        torque = rotations.rotate(quaternion, torque).astype(np.float32)
        for row, forces, torques in zip(links, force, torque):
            for link, f, t in zip(row, forces, torques):
                link.add_force_torque(f, t)


def joint_order(robot: RobotModel, articulation: Articulation) -> NDArray[np.intp]:
    """Return PhysX's number of every joint of the model: (J,)."""
    number = {joint.get_child_link().name: i for i, joint in enumerate(articulation.engine.active_joints)}
    return np.array([number[joint.child] for joint in robot.joints], np.intp)
