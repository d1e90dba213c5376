"""Loops that numba compiles, where it is installed (extra `fast`); the plain forms beside their callers mean the same.

A step of 64 worlds makes some hundred NumPy calls of a few hundred numbers each, so that the calls cost more than the
arithmetic; what runs at every step for every robot is therefore one call here. The last bits of the two forms may
differ, so a run's manifest says whether numba was there.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final, TypeAlias

import numpy as np

Kernel: TypeAlias = Callable[[], Callable[..., None] | None]
"""A function that returns the compiled loops, or None without numba; they are compiled when it is first called."""

_FRAMES: Final = "float64[:,:,:], float64[:,:,:,:]"
_LINKS: Final = "float64[:,:,:], float64[:,:,:], float64[:,:,:]"


_TAN_EIGHTH: Final = math.tan(math.pi / 8.0)
_ARC: Final = (
    1.0, -0.3333333333332844, 0.19999999998855109, -0.14285714180976392, 0.11111106180452865, -0.0909077307473686,
    0.07689953495298942, -0.06640233921673451, 0.056883491809884175, -0.043480520833406276, 0.021135371536498415,
)  # fmt: skip
"""Coefficients of arctan(x) / x in x^2 for |x| <= tan(pi / 8), at Chebyshev points; its error is below 1e-16."""


def kernel(signature: str) -> Callable[[Callable[..., None]], Kernel]:
    """Make a `Kernel` of loops with the numba `signature`; they write into their last arguments."""

    def decorate(loops: Callable[..., None]) -> Kernel:
        @cache
        def compiled() -> Callable[..., None] | None:
            if importlib.util.find_spec("numba") is None:
                return None
            numba = importlib.import_module("numba")  # here, because it takes as long to load as all the rest
            make = partial(numba.njit, f"void({signature})", error_model="numpy")
            try:
                return make(cache=True)(loops)
            except (OSError, RuntimeError):  # no room or no permission to keep the machine code for the next start
                return make()(loops)

        compiled.__doc__ = loops.__doc__
        return compiled

    return decorate


@kernel(f"float64[:,:,:], float64[:,:,:], int64[::1], float64[:,::1], float64[:,:,::1], {_FRAMES}")
def frames(
    link_position: Any, link_quaternion: Any, links: Any, offset: Any, turn: Any, position: Any, rotation: Any
) -> None:
    """Write where frames fixed to `links` (F,) are, as `guard_api.physics.transition` does.

    link_position (N, L, 3), link_quaternion (N, L, 4); offset (F, 3), turn (F, 3, 3) in link axes; position (N, F, 3),
    rotation (N, F, 3, 3).
    """
    for world in range(link_position.shape[0]):
        for f in range(links.shape[0]):
            k = links[f]
            w, x = link_quaternion[world, k, 0], link_quaternion[world, k, 1]
            y, z = link_quaternion[world, k, 2], link_quaternion[world, k, 3]
            R = (
                (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
                (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
                (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
            )
            for i in range(3):
                a, b, c = R[i]
                position[world, f, i] = link_position[world, k, i] + (
                    a * offset[f, 0] + b * offset[f, 1] + c * offset[f, 2]
                )
                for j in range(3):
                    rotation[world, f, i, j] = a * turn[f, 0, j] + b * turn[f, 1, j] + c * turn[f, 2, j]


@kernel(f"{_LINKS}, {_LINKS}, float64[::1], float64[::1], float64, int64[:,::1], float64[:,::1], float64[:,:,::1]")
def inertial(
    quaternion: Any,
    velocity: Any,
    angular: Any,
    old_quaternion: Any,
    old_velocity: Any,
    old_angular: Any,
    gravity: Any,
    field: Any,
    duration: float,
    sensors: Any,
    offset: Any,
    readings: Any,
) -> None:
    """Write the `readings` (N, S, 3) of `guard_api.sensors.inertial` in the axes of the links.

    quaternion (N, L, 4), velocity, angular (N, L, 3): of the links, now and a `duration` ago. sensors (S, 2): kind, in
    the order of `inertial.KINDS`, and link; offset (S, 3) in its axes.
    """
    moments = ((old_quaternion, old_velocity, old_angular), (quaternion, velocity, angular))
    site, arm = np.empty((2, 3)), np.empty(3)
    for world in range(readings.shape[0]):
        for s in range(sensors.shape[0]):
            kind, k = sensors[s, 0], sensors[s, 1]
            R = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
            for moment in range(2):
                q, v, turn = moments[moment]
                w, x, y, z = q[world, k, 0], q[world, k, 1], q[world, k, 2], q[world, k, 3]
                R = (
                    (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
                    (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
                    (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
                )
                for i in range(3):
                    a, b, c = R[i]
                    arm[i] = a * offset[s, 0] + b * offset[s, 1] + c * offset[s, 2]
                for i in range(3):
                    j, m = (i + 1) % 3, (i + 2) % 3
                    site[moment, i] = v[world, k, i] + (turn[world, k, j] * arm[m] - turn[world, k, m] * arm[j])
            for i in range(3):
                along = 0.0
                for j in range(3):
                    if kind == 0:
                        vector = (site[1, j] - site[0, j]) / duration - gravity[j]
                    elif kind == 1:
                        vector = site[1, j]
                    elif kind == 2:
                        vector = angular[world, k, j]
                    else:
                        vector = field[j]
                    along += vector * R[j][i]
                readings[world, s, i] = along


@kernel("float64[:,:], float64[:,:,:], float64[:,::1]")
def planar_distance(position: Any, points: Any, distance: Any) -> None:
    """Write the `distance` (N, K) in the plane from `position` (N, 3) to `points` (N, K, 3)."""
    for world in range(points.shape[0]):
        for k in range(points.shape[1]):
            x = points[world, k, 0] - position[world, 0]
            y = points[world, k, 1] - position[world, 1]
            distance[world, k] = math.sqrt(x * x + y * y)


@kernel("float64[:,:], float64[:,:,:], float64, float64[::1]")
def planar_depth(position: Any, centres: Any, size: float, depth: Any) -> None:
    """Write the summed `depth` (N,) of `position` (N, 3) in discs at `centres` (N, K, 3), as `Snapshot.depth` does."""
    for world in range(centres.shape[0]):
        depth[world] = 0.0
        for k in range(centres.shape[1]):
            x = centres[world, k, 0] - position[world, 0]
            y = centres[world, k, 1] - position[world, 1]
            depth[world] += max(size - math.sqrt(x * x + y * y), 0.0)


@kernel("float64[:,:,:], float64[:,:,:], float64[:,:,:], float64[:], float64[:,::1]")
def distance(points: Any, start: Any, end: Any, radius: Any, distance: Any) -> None:
    """Write the `distance` (N, K) of `points` (N, K, 3) from the nearest of S segments, as `Snapshot.distance` does.

    start, end (N, S, 3), radius (S,).
    """
    for world in range(points.shape[0]):
        for k in range(points.shape[1]):
            nearest = math.inf
            for s in range(radius.shape[0]):
                squared = projection = squares = 0.0
                for i in range(3):
                    along = end[world, s, i] - start[world, s, i]
                    squared += along * along
                    projection += (points[world, k, i] - start[world, s, i]) * along
                share = min(max(projection / squared, 0.0), 1.0) if squared > 0.0 else 0.0
                for i in range(3):
                    along = end[world, s, i] - start[world, s, i]
                    offset = points[world, k, i] - start[world, s, i] - share * along
                    squares += offset * offset
                nearest = min(nearest, math.sqrt(squares) - radius[s])
            distance[world, k] = nearest


@kernel(f"{_FRAMES}, float64[:,:], float64[:,:,::1]")
def compass(position: Any, rotation: Any, target: Any, directions: Any) -> None:
    """Write the `directions` (N, F, 2 or 3) of `guard_api.sensors.lidar.compass` to `target` (N, 3)."""
    axes = directions.shape[2]
    for world in range(target.shape[0]):
        for f in range(position.shape[1]):
            x = target[world, 0] - position[world, f, 0]
            y = target[world, 1] - position[world, f, 1]
            z = (target[world, 2] if axes == 3 else 0.0) - position[world, f, 2]
            squares = 0.0
            for i in range(axes):
                along = x * rotation[world, f, 0, i] + y * rotation[world, f, 1, i] + z * rotation[world, f, 2, i]
                directions[world, f, i] = along
                squares += along * along
            scale = 1.0 / (math.sqrt(squares) + 0.001)
            for i in range(axes):
                directions[world, f, i] *= scale


@kernel(f"{_FRAMES}, float64[:,:,:], boolean, float64, float64, boolean, float64[:,:,:,::1]")
def lidar(
    position: Any,
    rotation: Any,
    objects: Any,
    spatial: bool,
    gain: float,
    max_distance: float,
    aliasing: bool,
    readings: Any,
) -> None:
    """Write the largest reading of every cell into `readings` (N, F, bins, layers), as `guard_api.sensors.lidar` does.

    position (N, F, 3), rotation (N, F, 3, 3), objects (N, K, 3); max_distance: infinite for an exponential lidar.
    The azimuths are a loop of their own over all objects, without calls or branches, which a processor does eight at a
    time: arctan2, one by one and with half of its branches guessed wrong, took a third of the time.
    """
    (worlds, frames, bins, layers), count = readings.shape, objects.shape[1]
    local = np.empty((3, worlds * frames * count))
    i = 0
    for world in range(worlds):
        for f in range(frames):
            turn = rotation[world, f]
            for k in range(count):
                dx = objects[world, k, 0] - position[world, f, 0]
                dy = objects[world, k, 1] - position[world, f, 1]
                dz = (objects[world, k, 2] if spatial else 0.0) - position[world, f, 2]
                for j in range(3):
                    local[j, i] = dx * turn[0, j] + dy * turn[1, j] + dz * turn[2, j]
                i += 1

    around = np.empty(local.shape[1])
    for i in range(around.size):
        x, y = local[0, i], local[1, i]
        # The arctangent of a ratio up to 1, turned by 45 degrees where the ratio is above tan 22.5 degrees.
        low, high = min(abs(x), abs(y)), max(abs(x), abs(y))
        turned = low > _TAN_EIGHTH * high
        ratio = (low - high * turned) / (high + low * turned + (high == 0.0))
        u = ratio * ratio
        v = u * u
        series = (_ARC[0] + _ARC[1] * u) + (_ARC[2] + _ARC[3] * u) * v
        series += ((_ARC[4] + _ARC[5] * u) + (_ARC[6] + _ARC[7] * u) * v) * (v * v)
        series += ((_ARC[8] + _ARC[9] * u) + _ARC[10] * v) * (v * v * v * v)
        angle = ratio * series + 0.25 * math.pi * turned
        # By octants to the whole turn, from 0 to 2 pi.
        steep, behind, right = abs(y) > abs(x), x < 0.0, y < 0.0
        angle = angle * (1 - 2 * steep) + 0.5 * math.pi * steep
        angle = angle * (1 - 2 * behind) + math.pi * behind
        around[i] = (angle * (1 - 2 * right) + 2.0 * math.pi * right) * (bins / (2.0 * math.pi))

    flat = readings.reshape(worlds * frames, bins, layers)
    for row in range(flat.shape[0]):
        cells = flat[row]
        for i in range(row * count, (row + 1) * count):
            squares, layer, height = local[0, i] * local[0, i] + local[1, i] * local[1, i], 0, 0.0
            if spatial:
                z = local[2, i]
                up = (math.atan2(z, math.sqrt(squares)) / math.pi + 0.5) * layers
                layer = min(int(up), layers - 1)
                height = up - layer
                squares += z * z
            distance = math.sqrt(squares)
            near = max(0.0, 1.0 - distance / max_distance) if max_distance < math.inf else math.exp(-gain * distance)
            sector = min(int(around[i]), bins - 1)
            share = around[i] - sector
            cells[sector, layer] = max(cells[sector, layer], near)
            if aliasing:
                left, right = sector + 1 if sector < bins - 1 else 0, sector - 1 if sector else bins - 1
                cells[left, layer] = max(cells[left, layer], share * near)
                cells[right, layer] = max(cells[right, layer], (1.0 - share) * near)
                if spatial:
                    above, below = min(layer + 1, layers - 1), max(layer - 1, 0)
                    cells[sector, above] = max(cells[sector, above], height * near)
                    cells[sector, below] = max(cells[sector, below], (1.0 - height) * near)
