"""Poses and velocities of links and bodies, from what the engine computed on its way to the next step."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api import rotations
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
        rows = np.concatenate([of_engine, self._num_links + np.arange(num_bodies)]).astype(np.intp)
        bodies = np.concatenate([compiled.link_body[of_engine], compiled.body_body]).astype(np.intp)
        self._where = np.array([bodies, np.asarray(compiled.model.body_rootid, np.intp)[bodies], rows])
        self._joints = np.array([compiled.joint_qpos, compiled.joint_dof])
        self._frames = batch.bind("xpos"), batch.bind("xquat"), batch.bind("cvel"), batch.bind("subtree_com")
        self._state = batch.bind("qpos"), batch.bind("qvel")
        self._slides = self._merged.slides if self._merged else NO_SLIDES
        self._rest = np.zeros((self._num_links + num_bodies, 13))
        if self._merged is not None:
            self._merged.prepare(_parts(self._rest))
        self._num_worlds = batch.nsim
        self._no_bodies = None if num_bodies else _parts(np.empty((batch.nsim, 0, 13)))

    def read(self) -> tuple[Array, Frames, Frames]:
        """Return the joints' positions and velocities (2, N, J), the links' and the bodies' frames: new arrays."""
        block = np.empty((self._num_worlds, *self._rest.shape))
        joints = np.empty((2, self._num_worlds, self._joints.shape[1]))
        read = kernels.frames() or _read
        read(*self._frames, *self._state, self._where, self._joints, self._rest, *self._slides, joints, block)
        links = _parts(block[:, : self._num_links])
        if self._merged is not None:
            self._merged.fill(links, joints[0], joints[1])
        return joints, links, self._no_bodies or _parts(block[:, self._num_links :])


def _parts(block: Array) -> Frames:
    """Return the frames that lie in `block` (N, K, 13)."""
    return Frames(block[..., :3], block[..., 3:7], block[..., 7:10], block[..., 10:])


def _read(
    xpos: Array,
    xquat: Array,
    cvel: Array,
    subtree_com: Array,
    qpos: Array,
    qvel: Array,
    where: Index,
    columns: Index,
    rest: Array,
    slides: Index,
    factors: Array,
    joints: Array,
    block: Array,
) -> None:
    """Write the joints' state (2, N, J) from its `columns` (2, J) of qpos and qvel, and frames into `block` (N, K, 13).

    where (3, M): the engine's bodies, the roots of their trees, and their rows in `block`; rest (K, 13): what the other
    rows begin from. Then add what sliding joints do to massless links, `slides` (S, 3) and `factors` (S,).
    """
    block[...] = rest
    (bodies, roots, rows), (position, quaternion, linear, angular) = where, _parts(block)
    joints[0], joints[1] = qpos[:, columns[0]], qvel[:, columns[1]]
    at, velocity = xpos[:, bodies], cvel[:, bodies]
    position[:, rows], quaternion[:, rows], angular[:, rows] = at, xquat[:, bodies], velocity[..., :3]
    # MuJoCo's velocities are those of the point of each body that is at the centre of mass of its whole tree.
    linear[:, rows] = velocity[..., 3:] + rotations.cross(velocity[..., :3], at - subtree_com[:, roots])
    for (joint, link, axis), factor in zip(slides.tolist(), factors.tolist(), strict=True):
        position[:, link, axis] += factor * joints[0, :, joint]
        linear[:, link, axis] += factor * joints[1, :, joint]
