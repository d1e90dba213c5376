"""Pseudo-lidar: where objects of one kind are around the robot. Source: Ray et al. 2019 (Safety Gym), as in GUARD."""

from __future__ import annotations

from typing import Final

import numpy as np

from guard_api.physics.transition import Array, Snapshot

_TURN: Final[float] = 2.0 * np.pi


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
    x, y = _planar_offsets(snapshot, objects)
    nearness = np.exp(-gain * np.sqrt(x * x + y * y))
    position = np.arctan2(y, x) * (bins / _TURN)
    sector = np.floor(position)
    share = position - sector
    sector = sector.astype(np.intp)

    row = np.arange(num_worlds)[:, None] * bins
    flat = readings.reshape(-1)
    np.maximum.at(flat, (row + sector % bins).reshape(-1), nearness.reshape(-1))
    np.maximum.at(flat, (row + (sector + 1) % bins).reshape(-1), (share * nearness).reshape(-1))
    np.maximum.at(flat, (row + (sector - 1) % bins).reshape(-1), ((1.0 - share) * nearness).reshape(-1))
    return readings


def _planar_offsets(snapshot: Snapshot, objects: Array) -> tuple[Array, Array]:
    """Return x and y of the objects in the root link's axes: each (N, K) [m]; the objects' height counts as 0."""
    dx = objects[..., 0] - snapshot.position[:, None, 0]
    dy = objects[..., 1] - snapshot.position[:, None, 1]
    dz = -snapshot.position[:, None, 2]
    R = snapshot.rotation[:, :, :, None]
    return dx * R[:, 0, 0] + dy * R[:, 1, 0] + dz * R[:, 2, 0], dx * R[:, 0, 1] + dy * R[:, 1, 1] + dz * R[:, 2, 1]
