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


class Slides(NamedTuple):
    """What sliding joints add to links: `axes` (S, 3) joint, link and axis; `factors` (S,) of the joint's state."""

    axes: NDArray[np.intp]
    factors: Array


NO_SLIDES = Slides(np.empty((0, 3), np.intp), np.empty(0))


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
        axes = [(self._joints[j], self.links[k], axis) for j, k, axis in np.argwhere(directions)]
        self.slides = Slides(np.array(axes, np.intp).reshape(-1, 3), directions[np.nonzero(directions)])

    def prepare(self, rest: Frames) -> None:
        """Write what does not change into the rows of `rest` (L, ...), which is zero."""
        rest.position[self.links], rest.quaternion[self.links] = self._rest, self._quaternion

    def fill(self, frames: Frames, q: Array, qd: Array) -> None:
        """Write nothing into `frames`, a prepared one: these links need `slides` alone."""


class ChainedLinks:
    """Massless links anywhere in the tree, by forward kinematics from the first link."""

    slides = NO_SLIDES

    def __init__(self, robot: RobotModel, links: list[int]) -> None:
        self.links = links
        self._rows = rows_of(links)
        self._kinematics = Kinematics(robot, [robot.links[index].name for index in links])
        joints = [robot.joints[link - 1] for link in self._kinematics.order if link in links]
        slides = [joint.kind == "prismatic" for joint in joints]
        places = [(robot.link_index(j.child), robot.link_index(j.parent), robot.joint_index(j.name)) for j in joints]
        self._places = np.array([(*place, slide) for place, slide in zip(places, slides, strict=True)], np.intp)
        self._mounts = np.array([(*j.origin.position, *j.origin.quaternion, *j.axis) for j in joints])

    def prepare(self, rest: Frames) -> None:
        """Write what does not change: nothing."""

    def fill(self, frames: Frames, q: Array, qd: Array) -> None:
        """Write these links into `frames` (N, L, ...), which holds all others, from the joints' state (N, J)."""
        fast = kernels.chained()
        if fast is not None:
            fast(self._places, self._mounts, q, qd, *frames)
            return
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
