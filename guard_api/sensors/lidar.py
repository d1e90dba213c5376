"""Lidar and compass: where objects are, seen from the robot. Source: Ray et al. 2019 (Safety Gym), as in GUARD.

Both look from frames of the robot: the planar lidar from its reference, the others from each of its sensing frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from guard_api.physics.transition import Array, Snapshot, in_frame
from guard_api.sensors import kernels

_TURN: Final[float] = 2.0 * np.pi
_AROUND: Final = ((0, 0), (1, 0), (-1, 0))
_ABOVE_AND_BELOW: Final = ((0, 1), (0, -1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """A pseudo-lidar: the nearness of the objects of one kind, by direction, in [0, 1].

    bins: sectors of azimuth, counter-clockwise from the frame's x axis. layers: of elevation, from straight down to
    straight up; 0 for a planar lidar, for which heights count as 0. An object at distance d reads exp(-gain d), or
    max(0, 1 - d / max_distance) where a max_distance [m] is given, in its cell. With `aliasing` the cells beside it
    (not the diagonal ones) read a share that grows as the object nears them, so that the reading is continuous in
    azimuth. Each cell keeps its largest reading, so neither the number nor the order of objects matters. Size and
    occlusion are ignored.
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
        num_worlds, num_frames = position.shape[:2]
        readings = np.zeros((num_worlds, num_frames, self.bins, max(self.layers, 1)))
        fast = kernels.lidar()
        if fast is not None:
            law = (self.layers > 0, self.gain, self.max_distance or 0.0, self.aliasing)
            fast(position, rotation, objects, *law, readings)
        elif objects.shape[1]:
            self._scatter(position, rotation, objects, readings)
        return readings.reshape(num_worlds, -1)

    def _scatter(self, position: Array, rotation: Array, objects: Array, readings: Array) -> None:
        """Write the readings (N, F, bins, layers), which are zero; `kernels.lidar` says the same in loops."""
        offsets = objects[:, None] - position[:, :, None]
        if not self.layers:
            offsets[..., 2] = -position[:, :, None, 2]
        local = in_frame(rotation, offsets)  # (N, F, K, 3)
        x, y, z = local[..., 0], local[..., 1], local[..., 2]
        radius = np.sqrt(x * x + y * y)
        nearness = self._nearness(np.sqrt(radius * radius + z * z) if self.layers else radius)
        azimuth = np.arctan2(y, x) * (self.bins / _TURN)
        cell = [np.floor(azimuth).astype(np.intp), np.zeros(radius.shape, np.intp)]
        share = [azimuth - cell[0], np.zeros(radius.shape)]
        if self.layers:
            elevation = (np.arctan2(z, radius) / np.pi + 0.5) * self.layers
            cell[1] = np.minimum(np.floor(elevation).astype(np.intp), self.layers - 1)
            share[1] = elevation - cell[1]
        place = np.arange(readings[..., 0, 0].size).reshape(*readings.shape[:2], 1)
        for right, up in self._neighbours():
            weight = _weight(share[0], right) * _weight(share[1], up)
            layer = np.clip(cell[1] + up, 0, max(self.layers, 1) - 1)
            index = (place * self.bins + (cell[0] + right) % self.bins) * max(self.layers, 1) + layer
            np.maximum.at(readings.reshape(-1), index.reshape(-1), (weight * nearness).reshape(-1))

    def _nearness(self, distance: Array) -> Array:
        if self.max_distance is None:
            return np.exp(-self.gain * distance)
        return np.maximum(0.0, 1.0 - distance / self.max_distance)

    def _neighbours(self) -> tuple[tuple[int, int], ...]:
        """Return the cells that an object is read in, as steps of azimuth and elevation."""
        if not self.aliasing:
            return _AROUND[:1]
        return (*_AROUND, *_ABOVE_AND_BELOW) if self.layers else _AROUND


def _weight(share: Array, step: int) -> Array | float:
    """Return how much of an object `share` of the way through its cell is read `step` cells further."""
    return {0: 1.0, 1: share, -1: 1.0 - share}[step]


def compass(now: Snapshot, target: Array, axes: int) -> Array:
    """Return the direction of `target` (N, 3) [m] in the axes of every sensing frame: (N, F * axes).

    The vector is cut to its first `axes` (2 or 3) components and divided by its norm + 0.001 m, so it fades near the
    target instead of jumping. With 2 axes the target's height counts as 0, as in GUARD.
    """
    offset = target[:, None] - now.sensing_position
    if axes == 2:
        offset[..., 2] = -now.sensing_position[..., 2]
    direction = in_frame(now.sensing_rotation, offset[:, :, None])[:, :, 0, :axes]
    squares = direction * direction
    norm = np.sqrt(squares[..., 0] + squares[..., 1] + (squares[..., 2] if axes == 3 else 0.0))
    return (direction / (norm + 0.001)[..., None]).reshape(len(target), -1)
