"""Forward kinematics and link velocities of one robot, over all worlds at once.

Engines hand out link states one call at a time; where that is slower than recomputing them from the joint state, a
plugin uses this instead. A robot is compiled once: links are sorted by depth, so that all joints of one depth are one
NumPy operation, and links that never turn against their parent share its orientation.

Arrays inside are components first and worlds last, `(3, K, N)`, which keeps every operation contiguous. Sums run in a
fixed order and no linear-algebra library is called, so world i gets the same bits whatever N is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel

Array = NDArray[np.float64]
Rows: TypeAlias = slice | NDArray[np.intp]

# Row i, column c: which component of b, and with which sign, meets a[i] in component c of the quaternion product a b.
_PRODUCT_INDEX = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_PRODUCT_SIGN = np.array([[1.0, 1, 1, 1], [-1, 1, -1, 1], [-1, 1, 1, -1], [-1, -1, 1, 1]])


class Level(NamedTuple):
    """Rows of one depth and the rows of their parents, as slices wherever that is possible."""

    rows: slice
    parents: Rows


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkPoses:
    """Poses of the chosen links, and what `Kinematics.velocities` needs of the way to them.

    position: (N, S, 3) [m], quaternion: (N, S, 4); link frames in world axes.
    Of the K links computed, in the order of `Kinematics.order`, components first: origin: (3, K, N) [m];
    arm: (3, K - 1, N) [m] from the parent's origin; rotation: (3, 3, R, N), of which link k has `Kinematics.frames[k]`.
    """

    position: Array
    quaternion: Array
    origin: Array
    arm: Array
    rotation: Array


class Kinematics:
    """The kinematics of `robot`, compiled for the links named (default: all, in model order) and their ancestors.

    order: (K,) model indices of the links computed, by depth; the first is the base. joints: (K - 1,) model indices
    of the joints that move the others; slides: (K - 1, 1) which of them are prismatic; parents: (K - 1,) rows that they
    hang on; levels: the same by depth. frames: (K,) which rotation is each link's.
    Raises ValueError for an unknown link name.
    """

    def __init__(self, robot: RobotModel, links: Sequence[str] | None = None) -> None:
        chosen = [robot.link_index(name) for name in (robot.link_names if links is None else links)]
        parent = [-1, *(robot.link_index(joint.parent) for joint in robot.joints)]
        self.order, depth = _by_depth(parent, chosen)
        row = {link: k for k, link in enumerate(self.order)}
        joints = [robot.joints[link - 1] for link in self.order[1:]]
        self.parents = np.array([row[parent[link]] for link in self.order[1:]], np.intp)
        self.levels = _levels([depth[link] for link in self.order], self.parents)
        self.joints = np.array([link - 1 for link in self.order[1:]], np.intp)

        origin = np.array([j.origin.quaternion for j in joints]).reshape(-1, 4)
        self._axis = rotations.rotate(origin, np.array([j.axis for j in joints]).reshape(-1, 3)).T[:, :, None]
        self.slides = np.array([j.kind == "prismatic" for j in joints], bool)[:, None]
        self._any_slide = bool(self.slides.any())
        self._offset = np.array([j.origin.position for j in joints]).reshape(-1, 3).T[:, :, None]

        turns = [not slides or abs(q[0]) < 1.0 for slides, q in zip(self.slides[:, 0], origin, strict=True)]
        self.frames, turning, self._frame_levels = _orientations(self.parents, turns)
        self._parent_frames = rows_of(self.frames[self.parents], broadcast=True)
        self._turning_joint = self.joints[turning]
        # A prismatic joint on a turned origin is a turn by half * q = 0.
        self._half = np.where(self.slides[turning], 0.0, 0.5)
        axes = np.array([joints[i].axis for i in turning]).reshape(-1, 3)
        self._cos = _product_matrix(origin[turning])
        self._sin = _product_matrix(rotations.multiply(origin[turning], np.insert(axes, 0, 0.0, axis=1)))

        selected = np.array([row[link] for link in chosen], np.intp)
        self._selected, self._selected_frames = rows_of(selected), rows_of(self.frames[selected])

    def poses(self, base_position: Array, base_quaternion: Array, q: Array) -> LinkPoses:
        """Return the poses of the chosen links from the first link's pose (N, 3), (N, 4) and joints `q` (N, J)."""
        quaternion = self._orient(base_quaternion, q)
        rotation = rotation_matrices(quaternion)
        local = self._offset
        if self._any_slide:
            local = local + self._axis * np.where(self.slides, self.coordinates(q), 0.0)
        arm = np.add.reduce(rotation[:, :, self._parent_frames] * local, axis=1)
        origin = np.empty((3, len(self.order), len(q)))
        origin[:, 0] = base_position.T
        self.accumulate(origin, arm)
        return LinkPoses(
            position=self._worlds_first(origin, self._selected),
            quaternion=self._worlds_first(quaternion, self._selected_frames),
            origin=origin,
            arm=arm,
            rotation=rotation,
        )

    def velocities(self, poses: LinkPoses, base_linear: Array, base_angular: Array, qd: Array) -> tuple[Array, Array]:
        """Return linear (N, S, 3) [m/s] and angular (N, S, 3) [rad/s] velocity of the chosen links, world axes.

        poses: of the same configuration. base_linear, base_angular: (N, 3) of the first link's frame. qd: (N, J).
        """
        motion = self.axes(poses) * self.coordinates(qd)
        angular, linear = np.empty_like(poses.origin), np.empty_like(poses.origin)
        angular[:, 0], linear[:, 0] = base_angular.T, base_linear.T
        self.accumulate(angular, np.where(self.slides, 0.0, motion) if self._any_slide else motion)
        swing = cross(angular[:, self.parents], poses.arm)
        self.accumulate(linear, swing + np.where(self.slides, motion, 0.0) if self._any_slide else swing)
        return self._worlds_first(linear, self._selected), self._worlds_first(angular, self._selected)

    def axes(self, poses: LinkPoses) -> Array:
        """Return the joint axes in world axes: (3, K - 1, N)."""
        return np.add.reduce(poses.rotation[:, :, self._parent_frames] * self._axis, axis=1)

    def coordinates(self, q: Array) -> Array:
        """Return the joint values `q` (N, J) of the links computed: (K - 1, N)."""
        return q.T.take(self.joints, axis=0)

    def accumulate(self, total: Array, step: Array) -> None:
        """Add `step` (C, K - 1, N) along the tree: total[link] = total[parent] + step[link]; total[0] is given."""
        for rows, parents in self.levels:
            np.add(total[:, parents], step[:, rows.start - 1 : rows.stop - 1], out=total[:, rows])

    def _orient(self, base_quaternion: Array, q: Array) -> Array:
        """Return the distinct orientations of the links: (4, R, N); the first is the base's."""
        angle = self._half * q.T.take(self._turning_joint, axis=0)
        product = self._cos * np.cos(angle)
        product += self._sin * np.sin(angle)
        quaternion = np.empty((4, 1 + len(self._turning_joint), len(q)))
        quaternion[:, 0] = base_quaternion.T
        for rows, parents in self._frame_levels:
            local = product[:, :, rows.start - 1 : rows.stop - 1]
            np.add.reduce(quaternion[:, None, parents] * local, axis=0, out=quaternion[:, rows])
        return quaternion

    @staticmethod
    def _worlds_first(array: Array, rows: Rows) -> Array:
        return np.ascontiguousarray(array[:, rows].transpose(2, 1, 0))


def rotation_matrices(quaternion: Array) -> Array:
    """Return the rotation matrices (3, 3, ...) of unit quaternions (4, ...), components first."""
    double = quaternion + quaternion
    (wx, wy, wz), (xx, xy, xz) = double[0] * quaternion[1:], double[1] * quaternion[1:]
    (yy, yz), zz = double[2] * quaternion[2:], double[3] * quaternion[3]
    R = np.empty((3, 3, *quaternion.shape[1:]))
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - (yy + zz), xy - wz, xz + wy
    R[1, 0], R[1, 1], R[1, 2] = xy + wz, 1.0 - (xx + zz), yz - wx
    R[2, 0], R[2, 1], R[2, 2] = xz - wy, yz + wx, 1.0 - (xx + yy)
    return R


def cross(a: Array, b: Array) -> Array:
    """Return a x b of vectors (3, ...), components first."""
    a0, a1, a2 = a
    b0, b1, b2 = b
    x = a1 * b2
    result = np.empty((3, *x.shape))
    np.subtract(x, a2 * b1, out=result[0])
    np.subtract(a2 * b0, a0 * b2, out=result[1])
    np.subtract(a0 * b1, a1 * b0, out=result[2])
    return result


def rows_of(indices: Sequence[int] | NDArray[np.intp], *, broadcast: bool = False) -> Rows:
    """Return `indices` as a slice if they are consecutive, or with `broadcast` all equal (then one row), else as is."""
    rows = np.asarray(indices, np.intp)
    if len(rows) == 0:
        return rows
    if broadcast and (rows == rows[0]).all():
        return slice(int(rows[0]), int(rows[0]) + 1)
    return slice(int(rows[0]), int(rows[-1]) + 1) if (np.diff(rows) == 1).all() else rows


def _by_depth(parent: list[int], chosen: list[int]) -> tuple[list[int], dict[int, int]]:
    """Return the chosen links with their ancestors and the base, sorted by depth, and every one's depth."""
    depth = {0: 0}
    for link in chosen:
        path = []
        ancestor = link
        while ancestor not in depth:
            path.append(ancestor)
            ancestor = parent[ancestor]
        for step, below in enumerate(reversed(path), start=depth[ancestor] + 1):
            depth[below] = step
    return sorted(depth, key=lambda link: (depth[link], link)), depth


def _levels(depth: Sequence[int], parents: NDArray[np.intp]) -> list[Level]:
    """Return the levels below row 0 of rows sorted by `depth`; parents[k - 1] is the parent of row k."""
    levels = []
    for d in range(1, max(depth) + 1):
        rows = [k for k, at in enumerate(depth) if at == d]
        of_rows = rows_of(parents[rows[0] - 1 : rows[-1]], broadcast=True)
        levels.append(Level(slice(rows[0], rows[-1] + 1), of_rows))
    return levels


def _orientations(parents: NDArray[np.intp], turns: list[bool]) -> tuple[NDArray[np.intp], list[int], list[Level]]:
    """Return the orientation of every link row, the joint row of every orientation but the first, and their levels.

    Orientation 0 is the base's; every joint that turns begins another one; they are numbered by depth.
    """
    source, depth = [0], [0]  # of every link row: the link row where its orientation begins, and that one's depth
    for joint, parent in enumerate(parents):
        source.append(joint + 1 if turns[joint] else source[parent])
        depth.append(depth[parent] + turns[joint])
    rows = sorted({*source}, key=lambda row: (depth[row], row))
    number = {row: k for k, row in enumerate(rows)}
    frames = np.array([number[row] for row in source], np.intp)
    frame_parents = np.array([frames[parents[row - 1]] for row in rows[1:]], np.intp)
    return frames, [row - 1 for row in rows[1:]], _levels([depth[row] for row in rows], frame_parents)


def _product_matrix(quaternion: Array) -> Array:
    """Return M (4, 4, T, 1) such that sum_i a[i] M[i] is the product a b of a with b = `quaternion` (T, 4)."""
    return (quaternion.T[_PRODUCT_INDEX] * _PRODUCT_SIGN[:, :, None])[..., None]
