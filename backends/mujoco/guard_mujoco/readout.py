"""Poses and velocities of links and bodies, from what the engine computed on its way to the next step."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api.model.kinematics import Rows, rows_of
from guard_mujoco.compile import NO_BODY, CompiledScene
from guard_mujoco.merged import Frames, merged_links

Array = NDArray[np.float64]


class Readout:
    """Reads links and bodies out of a batch whose position and velocity stages are current."""

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        robot, num_links = compiled.scene.robot, len(compiled.link_body)
        merged = np.flatnonzero(compiled.link_body == NO_BODY).tolist()
        self._merged = merged_links(robot, merged) if robot and merged else None
        of_engine = np.setdiff1d(np.arange(num_links), self._merged.links if self._merged else [])
        self._links, self._split = rows_of(of_engine), len(of_engine)
        bodies = np.concatenate([compiled.link_body[of_engine], compiled.body_body])
        self._bodies, self._roots = bodies, np.asarray(compiled.model.body_rootid, np.intp)[bodies]
        self._xpos, self._xquat = batch.bind("xpos"), batch.bind("xquat")
        self._cvel, self._com = batch.bind("cvel"), batch.bind("subtree_com")
        self._blank = Frames(*(np.zeros((batch.nsim, num_links, size)) for size in (3, 4, 3, 3)))

    def read(self, q: Array, qd: Array) -> tuple[Frames, Frames]:
        """Return the frames of links and of bodies; `q`, `qd` (N, J) are the joints' present state."""
        engine = self._engine_frames()
        bodies = Frames(*(array[:, self._split :] for array in engine))
        if self._merged is None:
            return Frames(*(array[:, : self._split] for array in engine)), bodies
        links = Frames(*(array.copy() for array in self._blank))
        for whole, part in zip(links, engine, strict=True):
            whole[:, self._links] = part[:, : self._split]
        self._merged.fill(links, q, qd)
        return links, bodies

    def _engine_frames(self) -> Frames:
        """Return the frames of all links and bodies that are MuJoCo bodies: new arrays."""
        position = self._xpos.take(self._bodies, axis=1)
        velocity = self._cvel.take(self._bodies, axis=1)
        angular, linear = velocity[..., :3], velocity[..., 3:].copy()
        # MuJoCo's velocities are those of the point of each body that is at the centre of mass of its whole tree.
        arm = position - self._com.take(self._roots, axis=1)
        x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
        wx, wy, wz = angular[..., 0], angular[..., 1], angular[..., 2]
        linear[..., 0] += wy * z - wz * y
        linear[..., 1] += wz * x - wx * z
        linear[..., 2] += wx * y - wy * x
        return Frames(position, self._xquat.take(self._bodies, axis=1), linear, angular)


class EffortReadout:
    """The effort of the actuators on every joint, from the actuator forces of the last substep."""

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        robot = compiled.scene.robot
        servos = [(i, a) for i, a in enumerate(robot.actuators) if a.law != "thrust"] if robot else []
        joints = [robot.joint_index(str(a.joint)) for _, a in servos] if robot else []
        self._force = batch.bind("actuator_force") if servos else None
        # A joint's first actuator sets its effort, further ones add to it.
        self._first = rows_of([i for k, (i, _) in enumerate(servos) if joints[k] not in joints[:k]])
        self._first_joint = rows_of(list(dict.fromkeys(joints)))
        self._further = [(i, joints[k]) for k, (i, _) in enumerate(servos) if joints[k] in joints[:k]]
        self._limit = np.array([joint.effort_limit for joint in robot.joints]) if robot else np.empty(0)

    def write(self, effort: Array, rows: Rows) -> None:
        """Write the worlds `rows` of the effort on every joint with an actuator into `effort` (N, J) [N m or N]."""
        if self._force is None:
            return
        whole, force = effort[rows], self._force[rows]
        whole[:, self._first_joint] = force[:, self._first]
        for column, joint in self._further:
            whole[:, joint] += force[:, column]
        if self._further:
            whole = np.clip(whole, -self._limit, self._limit)
        effort[rows] = whole
