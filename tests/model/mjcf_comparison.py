"""The same MJCF text compiled by MuJoCo and read by GUARD, and whether both are one robot."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from guard_api import rotations
from guard_api.model.dynamics import Dynamics
from guard_api.model.library import load_robot_file
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw

TOLERANCE = 1e-9
"""Relative, as all comparisons here; absolute where the quantity has a scale of 1."""


def read(folder: Path, text: str | bytes, toml: str = "") -> RobotModel:
    """The robot of this file r.xml with this side file, empty as it may be."""
    (folder / "r.xml").write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "robot.toml").write_text(toml)
    return load_robot_file(folder / "r.xml")


class Pair:
    """A robot and MuJoCo's model of the same file. `base`: names in the file of the joints of a planar base."""

    def __init__(self, robot: RobotModel, text: str, base: tuple[str, ...] = ()) -> None:
        self.robot = robot
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.dynamics = Dynamics(robot)
        file_name = dict(zip(("base_x", "base_y", "base_yaw"), base, strict=False))
        self.joints = [self.model.joint(file_name.get(joint.name, joint.name)) for joint in robot.joints]
        self._base = 6 if robot.floating else 0
        self._dofs = [*range(self._base), *(int(joint.dofadr[0]) for joint in self.joints)]

    def assert_same(self, seed: int = 0) -> None:
        assert self.model.nv == self.dynamics.num_coordinates, "ball joints need another comparison"
        self.assert_same_joints()
        for q, qd, position, quaternion in self.configurations(seed, count=3):
            self.assert_same_at(q, qd, position, quaternion)

    def configurations(self, seed: int, count: int):
        """Random joint states, those of the file's own first, and base poses."""
        generator = np.random.default_rng(seed)
        for number in range(count):
            size = len(self.robot.joints)
            q = np.array([self.model.qpos0[joint.qposadr[0]] for joint in self.joints])
            quaternion = generator.normal(size=4) if self.robot.floating else np.array([1.0, 0.0, 0.0, 0.0])
            position = generator.normal(size=3) if self.robot.floating else np.array([0.0, 0.0, self._height])
            if number:
                q = generator.uniform(-1.0, 1.0, size)
            yield q, generator.normal(size=size), position, quaternion / np.linalg.norm(quaternion)

    @property
    def _height(self) -> float:
        return 0.0 if self.robot.base == "planar" else self.robot.home.height

    def assert_same_joints(self) -> None:
        for joint, theirs in zip(self.robot.joints, self.joints, strict=True):
            dof, index = theirs.dofadr[0], theirs.id
            assert (joint.limits is not None) == bool(self.model.jnt_limited[index]), joint.name
            if joint.limits:
                np.testing.assert_allclose(joint.limits, theirs.range, rtol=TOLERANCE)
            ours = [joint.armature, joint.damping, joint.friction_loss, joint.stiffness]
            them = [m[dof] for m in (self.model.dof_armature, self.model.dof_damping, self.model.dof_frictionloss)]
            np.testing.assert_allclose(ours, [*them, self.model.jnt_stiffness[index]], rtol=TOLERANCE)
            np.testing.assert_allclose(joint.rest_position, self.model.qpos_spring[theirs.qposadr[0]], rtol=TOLERANCE)
        moving = self.model.body_weldid > 0 if self.robot.base == "fixed" else self.model.body_weldid >= 0
        links = self.robot.links[1:] if self.robot.base == "fixed" else self.robot.links
        np.testing.assert_allclose(sum(link.mass for link in links), self.model.body_mass[moving].sum(), rtol=TOLERANCE)

    def set_state(self, q, qd, position, quaternion) -> None:
        data = self.data
        if self.robot.floating:
            data.qpos[:7] = [*position, *quaternion]
            data.qvel[:6] = 0.0
        for joint, value, rate in zip(self.joints, q, qd, strict=True):
            data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = value, rate
        mujoco.mj_forward(self.model, data)

    def assert_same_at(self, q, qd, position, quaternion) -> None:
        self.set_state(q, qd, position, quaternion)
        poses = self.dynamics.kinematics.poses(position[None], quaternion[None], q[None])
        where = {name: (poses.position[0, i], poses.quaternion[0, i]) for i, name in enumerate(self.robot.link_names)}
        self._assert_same_sites(where)
        self._assert_same_axes(where)
        self._assert_same_bodies(where)
        self._assert_same_dynamics(poses, qd, quaternion)

    def _assert_same_sites(self, where) -> None:
        """Sites are what sensors refer to: body frames and all in them must be where they were written."""
        for sensor in self.robot.sensors:
            if sensor.kind != "accelerometer":
                continue
            position, quaternion = where[sensor.link]
            site = self.data.site(int(self.model.sensor(sensor.name).objid[0]))
            ours = position + rotations.rotate(quaternion, sensor.pose.position)
            np.testing.assert_allclose(ours, site.xpos, atol=TOLERANCE)
            turn = rotations.to_matrix(rotations.multiply(quaternion, sensor.pose.quaternion))
            np.testing.assert_allclose(turn, site.xmat.reshape(3, 3), atol=TOLERANCE)

    def _assert_same_axes(self, where) -> None:
        for joint, theirs in zip(self.robot.joints, self.joints, strict=True):
            position, quaternion = where[joint.child]
            axis = rotations.rotate(quaternion, joint.axis)
            np.testing.assert_allclose(axis, self.data.xaxis[theirs.id], atol=TOLERANCE)
            if joint.kind != "prismatic":  # a point of the axis is as good as another
                off = np.cross(self.data.xanchor[theirs.id] - position, axis)
                np.testing.assert_allclose(off, 0.0, atol=TOLERANCE)

    def _assert_same_bodies(self, where) -> None:
        """Compare mass, com and inertia in world axes with those of the bodies welded together."""
        model, data = self.model, self.data
        for link in self.robot.links:
            if link.virtual or (self.robot.base == "fixed" and link is self.robot.links[0]):
                continue
            position, quaternion = where[link.name]
            R = rotations.to_matrix(quaternion)
            group = np.flatnonzero(model.body_weldid == model.body(link.name).weldid[0])
            mass = model.body_mass[group]
            com = mass @ data.xipos[group] / mass.sum()
            inertia = np.zeros((3, 3))
            for body in group:
                axes, r = data.ximat[body].reshape(3, 3), data.xipos[body] - com
                inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
                inertia += model.body_mass[body] * (r @ r * np.eye(3) - np.outer(r, r))
            np.testing.assert_allclose(link.mass, mass.sum(), rtol=TOLERANCE)
            np.testing.assert_allclose(position + R @ link.com, com, atol=TOLERANCE)
            ours = R @ np.array(link.inertia) @ R.T
            np.testing.assert_allclose(ours, inertia, atol=TOLERANCE * np.abs(inertia).max())

    def _assert_same_dynamics(self, poses, qd, quaternion) -> None:
        if self.model.nv == 0:
            return
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        T = np.eye(self.model.nv)
        if self.robot.floating:  # MuJoCo turns free bodies about their own axes
            T[3:6, 3:6] = rotations.to_matrix(quaternion).T
        M, bias = (T.T @ M @ T)[np.ix_(self._dofs, self._dofs)], (T.T @ self.data.qfrc_bias)[self._dofs]
        ours = self.dynamics.mass_matrix(poses)[0]
        np.testing.assert_allclose(ours, M, atol=TOLERANCE * np.abs(M).max())
        zero = np.zeros((1, 3))
        force = self.dynamics.bias_force(poses, zero, zero, qd[None])[0]
        np.testing.assert_allclose(force, bias, atol=TOLERANCE * max(1.0, np.abs(bias).max()))

    def assert_same_actuation(self, seed: int = 0) -> None:
        """Compare joint efforts, and thrusts as forces and torques on a floating base."""
        law, generator = ActuationLaw(self.robot), np.random.default_rng(seed)
        for q, qd, position, quaternion in self.configurations(seed, count=5):
            control = generator.uniform(-3.0, 3.0, self.model.nu)
            self.data.ctrl[:] = control
            self.set_state(q, qd, position, quaternion)
            geared = law.geared(control[None])
            effort = law.joint_effort(geared, q[None], qd[None])[0]
            ours = np.zeros(self.model.nv)
            ours[self._dofs[self._base :]] = effort
            poses = self.dynamics.kinematics.poses(position[None], quaternion[None], q[None])
            for number, i in enumerate(law.on_link):
                self._add_thrust(ours, self.robot.actuators[i], poses, self._thrust(law, geared, poses)[number])
            np.testing.assert_allclose(ours, self.data.qfrc_actuator, atol=TOLERANCE)

    @staticmethod
    def _thrust(law: ActuationLaw, geared, poses):
        return law.thrust(geared, poses.position[:, law.thrust_link, 2])[0]

    def _add_thrust(self, total, actuator, poses, force) -> None:
        index = self.robot.link_index(actuator.link)
        R = rotations.to_matrix(poses.quaternion[0, index])
        point = poses.position[0, index] + R @ actuator.point
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, jacobian, None, point, self.model.body(actuator.link).id)
        total += jacobian.T @ R @ force
