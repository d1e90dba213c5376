"""Lidar and compass: where objects are, seen from the robot. Source: Ray et al. 2019 (Safety Gym), as in GUARD.

Both look from frames of the robot: the planar lidar from its reference, the others from each of its sensing frames.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from guard_api import kernels
from guard_api.physics.transition import Array, Snapshot, in_frame
from guard_api.scene.limits import NOT_NEGATIVE, POSITIVE, check_limits, whole

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
    Raises SpecError for a number that its field does not allow.
    """

    bins: int = field(default=16, metadata=whole(1, 1000))
    layers: int = field(default=0, metadata=whole(0, 1000))
    gain: float = field(default=1.0, metadata=NOT_NEGATIVE)
    max_distance: float | None = field(default=None, metadata=POSITIVE)
    aliasing: bool = True

    def __post_init__(self) -> None:
        """Refuse what has no reading: readings are written unchecked."""
        check_limits(self, "Lidar")

    def read(self, now: Snapshot, objects: Array) -> Array:
        """Return the readings of `objects` (N, K, 3) [m]: (N, bins), or (N, F * bins * layers) frame by frame."""
        if not self.layers:
            return self._readings(now.position[:, None], now.rotation[:, None], objects)
        return self._readings(now.sensing_position, now.sensing_rotation, objects)

    def _readings(self, position: Array, rotation: Array, objects: Array) -> Array:
        readings = np.zeros((*position.shape[:2], self.bins, max(self.layers, 1)))
        limit = np.inf if self.max_distance is None else self.max_distance
        write = kernels.lidar() or _write
        write(position, rotation, objects, self.layers > 0, self.gain, limit, self.aliasing, readings)
        return readings.reshape(len(readings), -1)


def _write(
    position: Array,
    rotation: Array,
    objects: Array,
    spatial: bool,
    gain: float,
    max_distance: float,
    aliasing: bool,
    readings: Array,
) -> None:
    """Write the largest reading of every cell into `readings` (N, F, bins, layers), which is zero.

    position (N, F, 3), rotation (N, F, 3, 3): of the frames that see `objects` (N, K, 3). Heights count as 0 unless
    `spatial`. max_distance: infinite for an exponential lidar.
    """
    bins, layers = readings.shape[2:]
    offsets = objects[:, None] - position[:, :, None]
    if not spatial:
        offsets[..., 2] = -position[:, :, None, 2]
    x, y, z = np.moveaxis(in_frame(rotation, offsets), -1, 0)
    squares = x * x + y * y
    around = np.arctan2(y, x) * (bins / _TURN)
    around = np.where(around < 0.0, around + bins, around)
    sector = np.minimum(around.astype(np.intp), bins - 1)
    share = around - sector
    layer = np.zeros_like(sector)
    height = np.zeros_like(share)
    if spatial:
        up = (np.arctan2(z, np.sqrt(squares)) / np.pi + 0.5) * layers
        layer = np.minimum(up.astype(np.intp), layers - 1)
        height = up - layer
        squares = squares + z * z
    distance = np.sqrt(squares)
    linear = max_distance < np.inf
    nearness = np.maximum(0.0, 1.0 - distance / max_distance) if linear else np.exp(-gain * distance)
    beside = [(0, 0, np.ones_like(share))]
    if aliasing:
        beside += [(1, 0, share), (-1, 0, 1.0 - share)]
    if aliasing and spatial:
        beside += [(0, 1, height), (0, -1, 1.0 - height)]
    frame = np.arange(readings[..., 0, 0].size).reshape(*readings.shape[:2], 1)
    for right, above, weight in beside:
        cell = (frame * bins + (sector + right) % bins) * layers + np.clip(layer + above, 0, layers - 1)
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
