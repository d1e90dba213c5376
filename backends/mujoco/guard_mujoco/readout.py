"""Poses and velocities of links and bodies, from what the engine computed on its way to the next step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import RobotModel
from guard_mujoco.compile import NO_BODY, CompiledScene

Array = NDArray[np.float64]


class Frames(NamedTuple):
    """position (N, K, 3) [m], quaternion (N, K, 4), linear (N, K, 3) [m/s] and angular (N, K, 3) [rad/s] velocity."""

    position: Array
    quaternion: Array
    linear: Array
    angular: Array


class Readout:
    """Reads links and bodies out of a batch whose position and velocity stages are current."""

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        self._num_links = len(compiled.link_body)
        self._real = np.flatnonzero(compiled.link_body != NO_BODY)
        self._bodies = np.concatenate([compiled.link_body[self._real], compiled.body_body])
        self._roots = np.asarray(compiled.model.body_rootid, np.intp)[self._bodies]
        self._xpos, self._xquat = batch.bind("xpos"), batch.bind("xquat")
        self._cvel, self._com = batch.bind("cvel"), batch.bind("subtree_com")
        robot = compiled.scene.robot
        self._massless: MasslessLinks | None = None
        if robot and len(self._real) < self._num_links:
            self._massless = MasslessLinks(robot, np.flatnonzero(compiled.link_body == NO_BODY).tolist())

    def read(self, q: Array, qd: Array) -> tuple[Frames, Frames]:
        """Return the frames of links and of bodies; `q`, `qd` (N, J) are the joints' present state."""
        real = self._engine_frames()
        split = len(self._real)
        bodies = Frames(*(array[:, split:] for array in real))
        if self._massless is None:
            return Frames(*(array[:, :split] for array in real)), bodies
        base = Frames(*(array[:, 0] for array in real))  # the first link always has a body
        links = Frames(*(np.empty((len(q), self._num_links, array.shape[2])) for array in real))
        for whole, engine, massless in zip(links, real, self._massless.read(base, q, qd), strict=True):
            whole[:, self._real] = engine[:, :split]
            whole[:, self._massless.links] = massless
        return links, bodies

    def _engine_frames(self) -> Frames:
        """Return the frames of all links and bodies that are MuJoCo bodies: new arrays."""
        position = self._xpos.take(self._bodies, axis=1)
        velocity = self._cvel.take(self._bodies, axis=1)
        angular = velocity[..., :3].copy()
        linear = velocity[..., 3:]
        # MuJoCo's velocities are those of the point of each body that is at the centre of mass of its whole tree.
        arm = position - self._com.take(self._roots, axis=1)
        x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
        wx, wy, wz = angular[..., 0], angular[..., 1], angular[..., 2]
        linear[..., 0] += wy * z - wz * y
        linear[..., 1] += wz * x - wx * z
        linear[..., 2] += wx * y - wy * x
        return Frames(position, self._xquat.take(self._bodies, axis=1), linear, angular)


class MasslessLinks:
    """The frames of links that MuJoCo has merged into others.

    Massless links on the rails of a planar base, which are those of nearly all robots that have any, move by
    straight lines: position = rest + sum_j q_j direction_j, at a constant orientation. Others take the general way.
    """

    def __init__(self, robot: RobotModel, links: list[int]) -> None:
        self.links = links
        self._kinematics = Kinematics(robot, [robot.links[index].name for index in links])
        carriers = [self._kinematics.order[row] - 1 for row in range(1, len(self._kinematics.order))]
        on_rails = robot.base == "planar" and all(robot.joints[j].kind == "prismatic" for j in carriers)
        self._rails = carriers if on_rails else None
        if on_rails:
            rows = np.vstack([np.zeros(len(robot.joints)), np.eye(len(robot.joints))[carriers]])
            poses = self._kinematics.poses(
                np.zeros((len(rows), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1)), rows
            )
            self._rest, self._quaternion = poses.position[0], poses.quaternion[0]
            self._directions = poses.position[1:] - self._rest

    def read(self, base: Frames, q: Array, qd: Array) -> Frames:
        """Return the frames (N, len(links), ...) from the first link's (N, ...) and the joints' state (N, J)."""
        if self._rails is None:
            poses = self._kinematics.poses(base.position, base.quaternion, q)
            velocities = self._kinematics.velocities(poses, base.linear, base.angular, qd)
            return Frames(poses.position, poses.quaternion, *velocities)
        position = np.broadcast_to(self._rest, (len(q), *self._rest.shape)).copy()
        linear = np.zeros_like(position)
        for joint, direction in zip(self._rails, self._directions, strict=True):
            position += q[:, joint, None, None] * direction
            linear += qd[:, joint, None, None] * direction
        quaternion = np.broadcast_to(self._quaternion, (len(q), *self._quaternion.shape))
        return Frames(position, quaternion, linear, np.zeros_like(position))


class EffortReadout:
    """The effort of the actuators on every joint, from the actuator forces of the last substep."""

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        robot = compiled.scene.robot
        joints = robot.joints if robot else ()
        servos = [a for a in (robot.actuators if robot else ()) if a.law != "thrust"]
        self._force = batch.bind("actuator_force") if servos else None
        self._column = [robot.actuators.index(servo) for servo in servos] if robot else []
        self._joint = [robot.joint_index(str(servo.joint)) for servo in servos] if robot else []
        self._shared = len(set(self._joint)) < len(self._joint)
        self._limit = np.array([joint.effort_limit for joint in joints])
        self._zero = np.zeros((batch.nsim, len(joints)))

    def read(self) -> Array:
        """Return the effort on every joint: (N, J) [N m or N]."""
        effort = self._zero.copy()
        if self._force is None:
            return effort
        if not self._shared:
            effort[:, self._joint] = self._force[:, self._column]
            return effort
        for joint, column in zip(self._joint, self._column, strict=True):
            effort[:, joint] += self._force[:, column]
        return np.clip(effort, -self._limit, self._limit)
