"""Lidar and compass: where objects are, seen from the robot. Source: Ray et al. 2019 (Safety Gym), as in GUARD.

Both look from frames of the robot: the planar lidar from its reference, the others from each of its sensing frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from guard_api import kernels
from guard_api.physics.transition import Array, Snapshot, in_frame

_TURN: Final[float] = 2.0 * np.pi


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """A pseudo-lidar: the nearness of the objects of one kind, by direction, in [0, 1].

    bins: sectors of azimuth, counter-clockwise from the frame's x axis. layers: of elevation, from straight down to
    straight up; 0 for a planar lidar, for which heights count as 0. An object at distance d reads exp(-gain d), or
    max(0, 1 - d / max_distance) where a max_distance [m] is given, in its cell. With `aliasing` the cells beside it
    (not the diagonal ones) read a share that grows as the object nears them, so that a planar reading is continuous in
    azimuth; with layers, the cells above and below jump from one sector to the next, as in GUARD. Each cell keeps its
    largest reading, so neither the number nor the order of objects matters. Size and occlusion are ignored.
    """

    bins: int = 16
    layers: int = 0
    gain: float = 1.0
    max_distance: float | None = None
    aliasing: bool = True

    def read(self, now: Snapshot, objects: Array) -> Array:
        """Return the readings of `objects` (N, K, 3) [m]: (N, bins), or (N, F * bins * layers) frame by frame."""
        if not self.layers:
            return self._readings(now.position[:, None], now.rotation[:, None], objects)
        return self._readings(now.sensing_position, now.sensing_rotation, objects)

    def _readings(self, position: Array, rotation: Array, objects: Array) -> Array:
        x, y, z, distance = _sight(position, rotation, objects, spatial=self.layers > 0)
        azimuth = np.arctan2(y, x) * (self.bins / _TURN)
        elevation = (np.arctan2(z, np.sqrt(x * x + y * y)) / np.pi + 0.5) * self.layers if self.layers else azimuth
        readings = np.zeros((*azimuth.shape[:2], self.bins, max(self.layers, 1)))
        largest = kernels.largest() or _largest
        largest(azimuth, elevation, self._nearness(distance), self.layers > 0, self.aliasing, readings)
        return readings.reshape(len(readings), -1)

    def _nearness(self, distance: Array) -> Array:
        if self.max_distance is None:
            return np.exp(-self.gain * distance)
        return np.maximum(0.0, 1.0 - distance / self.max_distance)


def _sight(position: Array, rotation: Array, objects: Array, *, spatial: bool) -> Array:
    """Return where `objects` (N, K, 3) are in the axes of frames: (4, N, F, K) x, y, z and the distance [m].

    Heights count as 0 unless `spatial`.
    """
    local = np.empty((4, *position.shape[:2], objects.shape[1]))
    fast = kernels.sight()
    if fast is not None:
        fast(position, rotation, objects, spatial, local)
        return local
    offsets = objects[:, None] - position[:, :, None]
    if not spatial:
        offsets[..., 2] = -position[:, :, None, 2]
    local[:3] = np.moveaxis(in_frame(rotation, offsets), -1, 0)
    squares = local[0] * local[0] + local[1] * local[1]
    np.sqrt(squares + local[2] * local[2] if spatial else squares, out=local[3])
    return local


def _largest(azimuth: Array, elevation: Array, nearness: Array, spatial: bool, aliasing: bool, readings: Array) -> None:
    """Write the largest reading of every cell into `readings` (N, F, bins, layers), which is zero.

    azimuth, elevation: (N, F, K) in cells. nearness: (N, F, K) what an object reads in its own cell.
    """
    bins, layers = readings.shape[2:]
    around = np.where(azimuth < 0.0, azimuth + bins, azimuth)
    sector = np.minimum(around.astype(np.intp), bins - 1)
    share = around - sector
    layer = np.minimum(elevation.astype(np.intp), layers - 1) if spatial else np.zeros_like(sector)
    height = elevation - layer
    beside = [(0, 0, np.ones_like(share))]
    if aliasing:
        beside += [(1, 0, share), (-1, 0, 1.0 - share)]
    if aliasing and spatial:
        beside += [(0, 1, height), (0, -1, 1.0 - height)]
    frame = np.arange(readings[..., 0, 0].size).reshape(*readings.shape[:2], 1)
    for right, up, weight in beside:
        cell = (frame * bins + (sector + right) % bins) * layers + np.clip(layer + up, 0, layers - 1)
        np.maximum.at(readings.reshape(-1), cell.reshape(-1), (weight * nearness).reshape(-1))


def compass(now: Snapshot, target: Array, axes: int) -> Array:
    """Return the direction of `target` (N, 3) [m] in the axes of every sensing frame: (N, F * axes).

    The vector is cut to its first `axes` (2 or 3) components and divided by its norm + 0.001 m, so it fades near the
    target instead of jumping. With 2 axes the target's height counts as 0, as in GUARD.
    """
    fast = kernels.compass()
    if fast is not None:
        directions = np.empty((*now.sensing_position.shape[:2], axes))
        fast(now.sensing_position, now.sensing_rotation, target, directions)
        return directions.reshape(len(target), -1)
    offset = target[:, None] - now.sensing_position
    if axes == 2:
        offset[..., 2] = -now.sensing_position[..., 2]
    direction = in_frame(now.sensing_rotation, offset[:, :, None])[:, :, 0, :axes]
    squares = direction * direction
    norm = np.sqrt(squares[..., 0] + squares[..., 1] + (squares[..., 2] if axes == 3 else 0.0))
    return (direction / (norm + 0.001)[..., None]).reshape(len(target), -1)
