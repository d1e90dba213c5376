"""The actuation law on PhysX: read joints, set generalised forces and thrusts, once per substep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_sapien.articulation import Articulation
from guard_sapien.compile import Copy

Array = NDArray[np.float64]

_POSE = 7
"""Numbers per entity in `Scene.pack_poses()`: quaternion, position."""


class RobotControl:
    """`ActuationLaw` over the articulations of all worlds, springs and the explicit part -D qd of damping included.

    of_model (J,): PhysX's number of every model joint; PhysX numbers joints breadth-first.
    of_engine (J,): the model's number of every PhysX joint.
    """

    def __init__(self, robot: RobotModel, copy: Copy) -> None:
        self.law = ActuationLaw(robot)
        self.damping = np.array([joint.damping for joint in robot.joints])
        self.reads_position = self.law.has_springs or any(a.law == "position" for a in robot.actuators)
        servos = any(a.law in {"position", "velocity"} and a.kd for a in robot.actuators)
        self.reads_velocity = bool(self.damping.any()) or servos
        self.of_model = _joint_order(robot, _robot_of(copy))
        self.of_engine = np.argsort(self.of_model)
        self.thrust_links = np.unique(self.law.thrust_link)
        self._com = np.array([robot.links[i].com for i in self.law.thrust_link]).reshape(-1, 3)

    def wrenches(self, geared: Array, copies: Sequence[Copy]) -> Array:
        """Return force [N] and torque about the com [N m] on every thrust link: (n, T, 2, 3), in link axes.

        Constant over the substeps of the step that `copies` are about to make.
        """
        force = self.law.thrust(geared, self._heights(copies) if self.law.has_ceilings else None)
        wrench = np.stack([force, rotations.cross(self.law.thrust_point - self._com, force)], axis=2)
        return np.stack([wrench[:, self.law.thrust_link == link].sum(axis=1) for link in self.thrust_links], axis=1)

    def _heights(self, copies: Sequence[Copy]) -> Array:
        """Return the heights of the thrust links' origins: (n, T) [m]."""
        numbers = self.law.thrust_link
        links = [[_robot_of(copy).links[i] for i in numbers] for copy in copies]
        heights = np.array([[link.entity_pose.p[2] for link in row] for row in links], float)
        return heights.reshape(len(copies), len(numbers))

    def run(self, copies: Sequence[Copy], control: Array) -> Callable[[], Array]:
        """Return a function that sets the forces of one substep in `copies` under `control` (n, U).

        It returns the actuator effort on every joint: (n, J) [N m or N].
        """
        geared = self.law.geared(control)
        efforts = _JointEfforts(self, copies, geared)
        if not len(self.thrust_links):
            return efforts
        thrusts = _Thrusts(self, copies, self.wrenches(geared, copies))

        def both() -> Array:
            thrusts()
            return efforts()

        return both


class _JointEfforts:
    """Joint efforts of one substep in some worlds; the engine's methods are looked up once per step."""

    def __init__(self, control: RobotControl, copies: Sequence[Copy], geared: Array) -> None:
        engines = [_robot_of(copy).engine for copy in copies]
        self._control, self._geared = control, geared
        self._zeros = np.zeros((len(copies), len(control.of_model)))
        self._positions = [engine.get_qpos for engine in engines] if control.reads_position else []
        self._velocities = [engine.get_qvel for engine in engines] if control.reads_velocity else []
        self._set_force = [engine.set_qf for engine in engines]

    def __call__(self) -> Array:
        if not self._zeros.size:
            return self._zeros
        control = self._control
        qd = self._read(self._velocities)
        q = self._read(self._positions)
        effort = control.law.joint_effort(self._geared, q, qd)
        force = effort - control.damping * qd
        if control.law.has_springs:
            force += control.law.spring_effort(q)
        force = force.take(control.of_engine, axis=1).astype(np.float32)
        for set_force, row in zip(self._set_force, force, strict=True):
            set_force(row)
        return effort

    def _read(self, getters: list[Callable[[], NDArray[np.float32]]]) -> Array:
        """Return what the getters see (n, J) in the model's order, or zeros where no law looks at it."""
        if not getters:
            return self._zeros
        rows = np.concatenate([get() for get in getters]).reshape(self._zeros.shape)
        return rows.take(self._control.of_model, axis=1).astype(float)


class _Thrusts:
    """Thrust wrenches of one substep in some worlds, turned with their links."""

    def __init__(self, control: RobotControl, copies: Sequence[Copy], wrench: Array) -> None:
        self._wrench = wrench
        links = [[_robot_of(copy).links[i] for i in control.thrust_links] for copy in copies]
        self._poses, first = [], 0
        self._rows = np.empty((len(copies), len(control.thrust_links)), np.intp)
        for scene, indices in groupby(range(len(copies)), key=lambda i: copies[i].scene):
            for i in indices:
                self._rows[i] = first + copies[i].first_link + control.thrust_links
            self._poses.append(scene.pack_poses)
            first += len(scene.entities)
        self._add = [link.add_force_torque for row in links for link in row]

    def __call__(self) -> None:
        if not self._add:
            return
        poses = np.frombuffer(b"".join([pack() for pack in self._poses]), np.float32).reshape(-1, _POSE)
        turned = rotations.rotate(poses[self._rows, None, :4], self._wrench).astype(np.float32).reshape(-1, 2, 3)
        for add, force, torque in zip(self._add, turned[:, 0], turned[:, 1], strict=True):
            add(force, torque)


def _robot_of(copy: Copy) -> Articulation:
    if copy.robot is None:
        raise ValueError("this world has no robot")
    return copy.robot


def _joint_order(robot: RobotModel, articulation: Articulation) -> NDArray[np.intp]:
    number = {joint.get_child_link().name: i for i, joint in enumerate(articulation.engine.active_joints)}
    return np.array([number[joint.child] for joint in robot.joints], np.intp)
