"""The frames of massless links, which MuJoCo has merged into the links that they carry."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from guard_api.model.kinematics import Kinematics, rows_of
from guard_api.model.robot import RobotModel
from guard_mujoco import kernels

Array = NDArray[np.float64]


class Frames(NamedTuple):
    """position (N, K, 3) [m], quaternion (N, K, 4), linear (N, K, 3) [m/s] and angular (N, K, 3) [rad/s] velocity."""

    position: Array
    quaternion: Array
    linear: Array
    angular: Array


class LinksOnRails:
    """Massless links of a planar base that only slide: position = rest + sum_j q_j direction_j, never turning.

    Nearly all robots with massless links have just these. `links` includes the first link, which never moves.
    """

    def __init__(self, robot: RobotModel, links: list[int]) -> None:
        self.links = [0, *links]
        kinematics = Kinematics(robot, [robot.links[index].name for index in self.links])
        self._joints = sorted(index - 1 for index in kinematics.order if index > 0)
        unit = np.vstack([np.zeros(len(robot.joints)), np.eye(len(robot.joints))[self._joints]])
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(unit), 1))
        poses = kinematics.poses(np.zeros((len(unit), 3)), upright, unit)
        self._rest, self._quaternion = poses.position[0], poses.quaternion[0]
        directions = poses.position[1:] - self._rest
        slides = [(self._joints[j], self.links[k], axis) for j, k, axis in np.argwhere(directions)]
        self._slides = np.array(slides, np.intp).reshape(-1, 3)
        self._factors = directions[np.nonzero(directions)]

    def prepare(self, blank: Frames) -> None:
        """Write what does not change into `blank` (N, L, ...), which is zero."""
        blank.position[:, self.links], blank.quaternion[:, self.links] = self._rest, self._quaternion

    def fill(self, frames: Frames, q: Array, qd: Array) -> None:
        """Move these links in `frames` (N, L, ...), a prepared one, by the joints' state (N, J)."""
        move = kernels.slide() or _slide
        move(q, qd, self._slides, self._factors, frames.position, frames.linear)


def _slide(q: Array, qd: Array, slides: NDArray[np.intp], factors: Array, position: Array, linear: Array) -> None:
    """Add to links what sliding joints do: `slides` (K, 3) are joint, link and axis."""
    for (joint, link, axis), factor in zip(slides, factors, strict=True):
        position[:, link, axis] += factor * q[:, joint]
        linear[:, link, axis] += factor * qd[:, joint]


class ChainedLinks:
    """Massless links anywhere in the tree, by forward kinematics from the first link."""

    def __init__(self, robot: RobotModel, links: list[int]) -> None:
        self.links = links
        self._rows = rows_of(links)
        self._kinematics = Kinematics(robot, [robot.links[index].name for index in links])

    def prepare(self, blank: Frames) -> None:
        """Write what does not change: nothing."""

    def fill(self, frames: Frames, q: Array, qd: Array) -> None:
        """Write these links into `frames` (N, L, ...), which holds the first link, from the joints' state (N, J)."""
        poses = self._kinematics.poses(frames.position[:, 0], frames.quaternion[:, 0], q)
        velocities = self._kinematics.velocities(poses, frames.linear[:, 0], frames.angular[:, 0], qd)
        for whole, part in zip(frames, (poses.position, poses.quaternion, *velocities), strict=True):
            whole[:, self._rows] = part


MergedLinks: TypeAlias = LinksOnRails | ChainedLinks


def merged_links(robot: RobotModel, links: list[int]) -> MergedLinks:
    """Return what reads the massless links numbered `links` of `robot`."""
    names = {robot.links[index].name for index in links}
    carriers = [joint for joint in robot.joints if joint.child in names]
    first = robot.links[0].name
    on_rails = all(joint.kind == "prismatic" and joint.parent in {first, *names} for joint in carriers)
    return LinksOnRails(robot, links) if robot.base == "planar" and on_rails else ChainedLinks(robot, links)
