"""Pseudo-lidar: where objects of one kind are around the robot. Source: Ray et al. 2019 (Safety Gym), as in GUARD."""

from __future__ import annotations

from typing import Final

import numpy as np

from guard_api.physics.transition import Array, Snapshot

_TURN: Final[float] = 2.0 * np.pi
_NEIGHBOURS: Final = np.array([0, 1, -1])[:, None, None]


def pseudo_lidar(snapshot: Snapshot, objects: Array, bins: int, gain: float) -> Array:
    """Return the nearness of `objects` (N, K, 3) [m] in `bins` sectors about the root link: (N, bins) in [0, 1].

    Sector k covers the angles [k, k + 1) * 2 pi / bins, counter-clockwise from the link's x axis. An object at planar
    distance d reads exp(-gain d) in its sector; its neighbours read a share that grows as the object nears them, so
    that the reading is continuous when an object crosses a border. Each sector keeps its largest reading, so neither
    the number nor the order of objects matters. Size and occlusion are ignored; heights count as 0, as in GUARD.
    """
    num_worlds, num_objects = objects.shape[:2]
    readings = np.zeros((num_worlds, bins))
    if num_objects == 0:
        return readings
    offsets = objects - snapshot.position[:, None]
    offsets[..., 2] = -snapshot.position[:, None, 2]
    local = snapshot.in_robot_frame(offsets)
    x, y = local[..., 0], local[..., 1]
    nearness = np.exp(-gain * np.sqrt(x * x + y * y))
    position = np.arctan2(y, x) * (bins / _TURN)
    sector = np.floor(position)
    share = position - sector

    values = np.empty((3, num_worlds, num_objects))
    values[0], values[1], values[2] = 1.0, share, 1.0 - share  # in its own sector, the next, the one before
    values *= nearness
    sectors = np.arange(bins).take(sector.astype(np.intp) + _NEIGHBOURS, mode="wrap")  # a modulo, but faster
    first = np.arange(num_worlds)[:, None] * bins
    np.maximum.at(readings.reshape(-1), (first + sectors).reshape(-1), values.reshape(-1))
    return readings
