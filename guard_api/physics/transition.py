"""What tasks, constraints and sensors see: two instants of N worlds and the action between them.

Everything that scores or observes is a pure function of a `Transition`; that is why it cannot differ between engines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guard_api import kernels, rotations
from guard_api.model.robot import Frame, RobotModel
from guard_api.physics.state import State
from guard_api.shapes import ORIGIN

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """One instant of N worlds. F sensing frames and S segments of the robot, see `RobotModel.lidar` and `.segments`.

    state: the physical state, in the conventions of `guard_api.conventions`.
    position (N, 3) [m], linear_velocity (N, 3) [m/s], angular_velocity (N, 3) [rad/s]: of the robot's reference frame,
    world axes. rotation: (N, 3, 3) of that frame; its columns are the frame's axes in the world.
    sensing_position (N, F, 3) [m], sensing_rotation (N, F, 3, 3): of the frames that carry lidar and compass.
    segment_start, segment_end: (N, S, 3) [m]. segment_radius: (S,) [m].
    bodies: group name -> positions (N, count, 3) [m] of every group, phantoms included.
    origins: group name -> positions (N, count, 3) [m] where the bodies were last placed.
    slices: name of a physical group -> where it lies on axis 1 of `State.body_*`.
    steps_since_success: (N,) environment steps since the task was last achieved in this episode; large before that.
    """

    state: State
    position: Array
    rotation: Array
    linear_velocity: Array
    angular_velocity: Array
    sensing_position: Array
    sensing_rotation: Array
    segment_start: Array
    segment_end: Array
    segment_radius: Array
    bodies: Mapping[str, Array]
    origins: Mapping[str, Array]
    slices: Mapping[str, slice]
    steps_since_success: NDArray[np.int64]

    def contact(self, group: str) -> NDArray[np.bool_]:
        """Return which bodies of a physical `group` the robot touched during the step: (N, count)."""
        return self.state.body_contact[:, self.slices[group]]

    def body_velocity(self, group: str) -> Array:
        """Return the linear velocities of a physical `group`: (N, count, 3) [m/s]."""
        return self.state.body_linear_velocity[:, self.slices[group]]

    def depth(self, centres: Array, size: float, *, spatial: bool) -> Array:
        """Return sum_k max(0, size - d_k) for round zones of radius `size` [m] at `centres` (N, K, 3): (N,) [m].

        d is the distance in the plane from the robot's reference to a centre, or with `spatial` the distance in space
        from the robot, so that a thick robot may be deeper than `size`. Source: GUARD's engine.
        """
        fast = None if spatial else kernels.planar_depth()
        if fast is None:
            away = self.distance(centres) if spatial else planar_distance(self.position, centres)
            return np.maximum(size - away, 0.0).sum(axis=1)
        depth = np.empty(len(centres))
        fast(self.position, centres, size, depth)
        return depth

    def distance(self, points: Array) -> Array:
        """Return how far `points` (N, K, 3) are from the robot: (N, K) [m].

        From its nearest segment, negative inside; from the reference's origin for a robot without segments.
        """
        start, end, radius = self.segment_start, self.segment_end, self.segment_radius
        if not len(radius):
            start = end = self.position[:, None]
            radius = np.zeros(1)
        fast = kernels.distance()
        if fast is None:
            return _distance(points, start, end, radius)
        distance = np.empty(points.shape[:2])
        fast(points, start, end, radius, distance)
        return distance


def _distance(points: Array, start: Array, end: Array, radius: Array) -> Array:
    """Return the distance of points (N, K, 3) from the nearest of the segments (N, S, 3), (S,): (N, K) [m]."""
    # By axis: (N, K, S) arrays are summed several times faster than the last axis of (N, K, S, 3) ones.
    along = (end - start)[:, None]
    ax, ay, az = along[..., 0], along[..., 1], along[..., 2]
    x, y, z = (points[:, :, None, axis] - start[:, None, :, axis] for axis in range(3))
    squared = ax * ax + ay * ay + az * az
    share = (x * ax + y * ay + z * az) / np.where(squared > 0.0, squared, 1.0)
    share = np.minimum(np.maximum(share, 0.0), 1.0)
    x, y, z = x - share * ax, y - share * ay, z - share * az
    return (np.sqrt(x * x + y * y + z * z) - radius).min(axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """One environment step: from `previous` to `now` under `action` (N, A), taking `duration` [s].

    Right after a reset `previous` is `now` and the action is zero.
    """

    previous: Snapshot
    now: Snapshot
    action: Array
    duration: float


class SnapshotReader:
    """Reads `Snapshot`s of one robot out of states: where its reference, sensing frames and segments are."""

    def __init__(self, robot: RobotModel) -> None:
        reference = robot.reference or Frame(name=robot.root, link=robot.root)
        self._reference = _FrameReader(robot, [reference])
        self._link = robot.link_index(reference.link)
        self._shifted = reference.pose.position != ORIGIN
        self._sensing = _FrameReader(robot, robot.lidar) if robot.lidar else None
        ends = [frame for segment in robot.segments for frame in (segment.start, segment.end)]
        self._ends = _FrameReader(robot, ends) if ends else None
        self._radius = np.array([segment.radius for segment in robot.segments])

    def read(self, state: State, **rest: Any) -> Snapshot:
        """Return the snapshot of `state`; `rest` are the fields that are not the robot's."""
        position, rotation = self._reference.read(state)
        sensing = (position, rotation) if self._sensing is None else self._sensing.read(state)
        start = end = position[:, :0]
        if self._ends is not None:
            ends = self._ends.read(state)[0]
            start, end = ends[:, ::2], ends[:, 1::2]
        velocity = state.link_linear_velocity[:, self._link]
        if self._shifted:
            arm = position[:, 0] - state.link_position[:, self._link]
            velocity = velocity + rotations.cross(state.link_angular_velocity[:, self._link], arm)
        return Snapshot(
            state=state,
            position=position[:, 0],
            rotation=rotation[:, 0],
            linear_velocity=velocity,
            angular_velocity=state.link_angular_velocity[:, self._link],
            sensing_position=sensing[0],
            sensing_rotation=sensing[1],
            segment_start=start,
            segment_end=end,
            segment_radius=self._radius,
            **rest,
        )


class _FrameReader:
    """Where some frames of a robot are, in the world."""

    def __init__(self, robot: RobotModel, frames: Sequence[Frame]) -> None:
        self._links = np.array([robot.link_index(frame.link) for frame in frames], np.intp)
        self._offset = np.array([frame.pose.position for frame in frames]).reshape(-1, 3)
        self._turn = rotations.to_matrix(np.array([frame.pose.quaternion for frame in frames]).reshape(-1, 4))

    def read(self, state: State) -> tuple[Array, Array]:
        """Return positions (N, F, 3) and rotation matrices (N, F, 3, 3)."""
        fast = kernels.frames()
        if fast is not None:
            shape = (len(state.time), len(self._links), 3)
            position, rotation = np.empty(shape), np.empty((*shape, 3))
            fast(state.link_position, state.link_quaternion, self._links, self._offset, self._turn, position, rotation)
            return position, rotation
        quaternion = state.link_quaternion[:, self._links]
        position = state.link_position[:, self._links] + rotations.rotate(quaternion, self._offset)
        return position, rotations.to_matrix(quaternion) @ self._turn


def in_frame(rotation: Array, vectors: Array) -> Array:
    """Return world vectors (N, F, K, 3) in the axes of frames with `rotation` (N, F, 3, 3): (N, F, K, 3)."""
    # A stacked product is one small product per frame, so a world's bits do not depend on N.
    return vectors @ rotation


def planar_distance(position: Array, points: Array) -> Array:
    """Return the distances in the plane from `position` (N, 3) to `points` (N, K, 3): (N, K) [m]."""
    fast = kernels.planar_distance()
    if fast is None:
        x, y = points[..., 0] - position[:, :1], points[..., 1] - position[:, 1:2]
        return np.sqrt(x * x + y * y)
    distance = np.empty(points.shape[:2])
    fast(position, points, distance)
    return distance
