"""Loops that numba compiles, where it is installed (extra `fast`); the plain forms beside their callers mean the same.

The last bits of the two may differ, so a run's manifest says whether numba was there.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Callable
from functools import cache
from typing import Any, Final

_FRAMES: Final = "float64[:,:,:], float64[:,:,:,:], float64[:,:,:]"


@cache
def lidar() -> Callable[..., None] | None:
    """Return the compiled loops of `guard_api.sensors.lidar.Lidar`, or None.

    Arguments: position (N, F, 3), rotation (N, F, 3, 3), objects (N, K, 3), spatial, gain, max_distance or 0, aliasing,
    readings (N, F, bins, layers), zero before.
    """
    return _compiled(f"void({_FRAMES}, boolean, float64, float64, boolean, float64[:,:,:,::1])", _lidar)


def _compiled(signature: str, function: Callable[..., None]) -> Callable[..., None] | None:
    if importlib.util.find_spec("numba") is None:
        return None
    numba = importlib.import_module("numba")  # here, because it takes as long to load as all the rest
    return numba.njit(signature, cache=True)(function)


def _lidar(
    position: Any, rotation: Any, objects: Any, spatial: bool, gain: float, reach: float, aliasing: bool, readings: Any
) -> None:
    bins, layers = readings.shape[2], readings.shape[3]
    for world in range(objects.shape[0]):
        for frame in range(position.shape[1]):
            R, cells = rotation[world, frame], readings[world, frame]
            for k in range(objects.shape[1]):
                dx = objects[world, k, 0] - position[world, frame, 0]
                dy = objects[world, k, 1] - position[world, frame, 1]
                dz = (objects[world, k, 2] if spatial else 0.0) - position[world, frame, 2]
                x = dx * R[0, 0] + dy * R[1, 0] + dz * R[2, 0]
                y = dx * R[0, 1] + dy * R[1, 1] + dz * R[2, 1]
                radius = math.sqrt(x * x + y * y)
                distance, layer, height = radius, 0, 0.0
                if spatial:
                    z = dx * R[0, 2] + dy * R[1, 2] + dz * R[2, 2]
                    distance = math.sqrt(x * x + y * y + z * z)
                    elevation = (math.atan2(z, radius) / math.pi + 0.5) * layers
                    layer = min(math.floor(elevation), layers - 1)
                    height = elevation - layer
                nearness = max(0.0, 1.0 - distance / reach) if reach > 0.0 else math.exp(-gain * distance)
                azimuth = math.atan2(y, x) * (bins / (2.0 * math.pi))
                first = math.floor(azimuth)
                share, sector = azimuth - first, int(first) % bins
                cells[sector, layer] = max(cells[sector, layer], nearness)
                if aliasing:
                    right, left = (sector + 1) % bins, (sector - 1) % bins
                    cells[right, layer] = max(cells[right, layer], share * nearness)
                    cells[left, layer] = max(cells[left, layer], (1.0 - share) * nearness)
                    if spatial:
                        up, down = min(layer + 1, layers - 1), max(layer - 1, 0)
                        cells[sector, up] = max(cells[sector, up], height * nearness)
                        cells[sector, down] = max(cells[sector, down], (1.0 - height) * nearness)
