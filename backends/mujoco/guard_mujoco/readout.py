"""Poses and velocities of links and bodies, from what the engine computed on its way to the next step."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.kinematics import Rows, rows_of
from guard_mujoco import kernels
from guard_mujoco.compile import NO_BODY, CompiledScene
from guard_mujoco.merged import NO_SLIDES, Frames, merged_links

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Readout:
    """Reads links and bodies out of a batch whose position and velocity stages are current."""

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        robot, self._num_links = compiled.scene.robot, len(compiled.link_body)
        merged = np.flatnonzero(compiled.link_body == NO_BODY).tolist()
        self._merged = merged_links(robot, merged) if robot and merged else None
        of_engine = np.setdiff1d(np.arange(self._num_links), self._merged.links if self._merged else [])
        num_bodies = len(compiled.body_body)
        self._rows = np.concatenate([of_engine, self._num_links + np.arange(num_bodies)]).astype(np.intp)
        self._bodies = np.concatenate([compiled.link_body[of_engine], compiled.body_body]).astype(np.intp)
        self._roots = np.asarray(compiled.model.body_rootid, np.intp)[self._bodies]
        self._xpos, self._xquat = batch.bind("xpos"), batch.bind("xquat")
        self._cvel, self._com = batch.bind("cvel"), batch.bind("subtree_com")
        total = self._num_links + num_bodies
        self._slides = self._merged.slides if self._merged else NO_SLIDES
        self._blank = np.zeros((batch.nsim, total, 13))
        if self._merged is not None:
            self._merged.prepare(_parts(self._blank))

    def read(self, q: Array, qd: Array) -> tuple[Frames, Frames]:
        """Return the frames of links and of bodies, new arrays; `q`, `qd` (N, J) are the joints' present state."""
        block = self._blank.copy()
        frames = _parts(block)
        read = kernels.frames() or _read
        engine = (self._xpos, self._xquat, self._cvel, self._com)
        read(*engine, self._bodies, self._roots, self._rows, q, qd, *self._slides, *frames)
        links = frames if self._num_links == block.shape[1] else _parts(block[:, : self._num_links])
        if self._merged is not None:
            self._merged.fill(links, q, qd)
        return links, _parts(block[:, self._num_links :])


def _parts(block: Array) -> Frames:
    """Return the frames that lie in `block` (N, K, 13)."""
    return Frames(block[..., :3], block[..., 3:7], block[..., 7:10], block[..., 10:])


def _read(
    xpos: Array,
    xquat: Array,
    cvel: Array,
    subtree_com: Array,
    bodies: Index,
    roots: Index,
    rows: Index,
    q: Array,
    qd: Array,
    slides: Index,
    factors: Array,
    position: Array,
    quaternion: Array,
    linear: Array,
    angular: Array,
) -> None:
    """Write the frames of `bodies` (K,), in trees that start at `roots` (K,), into the `rows` (K,) of the last four.

    Then add what sliding joints do to massless links, `slides` (S, 3) and `factors` (S,).
    """
    at, velocity = xpos[:, bodies], cvel[:, bodies]
    position[:, rows], quaternion[:, rows], angular[:, rows] = at, xquat[:, bodies], velocity[..., :3]
    # MuJoCo's velocities are those of the point of each body that is at the centre of mass of its whole tree.
    linear[:, rows] = velocity[..., 3:] + rotations.cross(velocity[..., :3], at - subtree_com[:, roots])
    for (joint, link, axis), factor in zip(slides.tolist(), factors.tolist(), strict=True):
        position[:, link, axis] += factor * q[:, joint]
        linear[:, link, axis] += factor * qd[:, joint]


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
            np.clip(whole, -self._limit, self._limit, out=whole)
        if not isinstance(rows, slice):  # a slice is a view
            effort[rows] = whole
