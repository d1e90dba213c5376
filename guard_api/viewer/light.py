"""How a picture is lit: a soft sun, an even sky, and the shade that things cast on each other.

Linear light, one set of lamps for every scene, so that pictures of different scenes and engines compare.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api.viewer.footprint import Footprint
from guard_api.viewer.surfaces import Surface
from guard_api.viewer.tracer import FAR, Tracer, unit

Float = NDArray[np.floating]
Mask = NDArray[np.bool_]

SUN: Final = unit(np.array([[-0.35, -0.75, 1.25]], np.float32))[0]
"""Direction to the sun."""

SUN_RADIUS: Final = 0.07
"""Sine of the sun's angular radius: how soft shadows are. The true sun's is 0.005."""

SUN_COLOUR: Final = np.array([1.00, 0.96, 0.90], np.float32) * np.float32(0.78)
SKY_COLOUR: Final = np.array([0.90, 0.96, 1.05], np.float32) * np.float32(0.52)
FLOOR_COLOUR: Final = np.array([0.95, 0.95, 0.95], np.float32) * np.float32(0.26)
"""Light from the sun, and what comes from above and below where nothing is in the way."""

SKY_REACH: Final = 0.8
"""Distance [m] within which things keep the sky's light from each other."""

OFFSET: Final = np.float32(1e-3)
"""How far off a surface rays start [m]: more than a round shape's triangles cut off."""

PENUMBRA: Final = 0.15
"""Width of a soft shadow's edge over the height of what casts it, rounded up."""

PASSES: Final = 4
"""Calls of `Lamps.shade` for one pixel; each sends other rays."""

SUN_RAYS: Final = (3, 12)
SKY_RAYS: Final = (4, 4)
"""Rays to a lamp from one point in one pass, and how many where those disagree, as at the edge of a shade."""


def _r2(count: int) -> Float:
    """Return `count` points (radius, turn), both 0..1, that fill a disc evenly after any number of them.

    Source: Roberts 2018, the R2 sequence.
    """
    k = np.arange(count)
    return np.stack([np.sqrt((0.5 + 0.7548776662466927 * k) % 1.0), (0.5 + 0.5698402909980532 * k) % 1.0], axis=1)


def _lattice(count: int) -> Float:
    """Return `count` points (radius, turn), both 0..1, that fill a disc at evenly spaced turns."""
    k = np.arange(count)
    return np.stack([np.sqrt((0.5 + 0.6180339887498949 * k) % 1.0), k / count], axis=1)


SUN_PATTERN: Final = _r2(PASSES * SUN_RAYS[1])
SKY_PATTERN: Final = _lattice(PASSES * SKY_RAYS[1])
"""The rays of one pixel in a lamp's cone. Most of the sky's shade comes from one side, so even turns matter there."""


class Lamps:
    """The sun and the sky over `surface`, which `tracer` holds."""

    def __init__(self, surface: Surface, tracer: Tracer) -> None:
        self._tracer = tracer
        points = surface.vertices
        height = points[:, 2:].clip(min=0.0)
        self._near = Footprint(points[:, :2], surface.starts, SKY_REACH)
        shadow = points[:, :2] - height * (SUN[:2] / SUN[2])
        self._shadow = Footprint(shadow, surface.starts, PENUMBRA * float(height.max(initial=0.1)))

    def shade(
        self, point: Float, normal: Float, colour: Float, view: Float, spin: Float, turn: int, on_floor: Mask
    ) -> Float:
        """Return the light (P, 3) that leaves `point` (P, 3) [m] against the direction `view` (P, 3).

        normal: (P, 3) unit. colour: (P, 3) reflectance. spin: (P,) in 0..1, turns each pixel's pattern of rays. turn:
        which of the `PASSES` this is. on_floor: (P,) which points are on the plane z = 0.
        """
        start = point + OFFSET * normal
        sun, sky = np.maximum(normal @ SUN, 0.0), np.ones(len(point), np.float32)
        rows = np.flatnonzero((sun > 0.0) & (~on_floor | self._shadow.covers(point[:, :2])))
        cone = Cone(np.repeat(SUN[None], len(rows), axis=0), SUN_RADIUS, SUN_PATTERN[turn::PASSES])
        sun[rows] *= self._open(cone, SUN_RAYS, FAR, start[rows], spin[rows])
        rows = np.flatnonzero(~on_floor | self._near.covers(point[:, :2]))
        cone = Cone(normal[rows], 1.0, SKY_PATTERN[turn::PASSES])
        sky[rows] = self._open(cone, SKY_RAYS, SKY_REACH, start[rows], spin[rows])
        up = np.float32(0.5) + np.float32(0.5) * normal[:, 2:]
        ambient = (up * SKY_COLOUR + (1 - up) * FLOOR_COLOUR) * sky[:, None]
        gloss = np.maximum((unit(SUN - view) * normal).sum(axis=1), 0.0) ** 40 * sun
        return colour * (ambient + sun[:, None] * SUN_COLOUR) + np.float32(0.16) * gloss[:, None]

    def _open(self, cone: Cone, rays: tuple[int, int], reach: float, start: Float, spin: Float) -> Float:
        """Return the share (P,) of the `rays` in `cone` that get away from `start` (P, 3)."""
        few, many = rays
        free, sent = np.zeros(len(start), np.float32), np.full(len(start), few, np.float32)
        rows = np.arange(len(start))
        for k in range(many):
            if k == few:
                rows = np.flatnonzero((free > 0) & (free < few))
                cone, start, spin = cone.at(rows), start[rows], spin[rows]
                sent[rows] = many
            free[rows] += ~self._tracer.blocked(start, cone.direction(k, spin), reach)
        return free / sent


class Cone:
    """Directions about each `axis` (P, 3) unit; `sine` of the half angle; `pattern` (K, 2) as of `_r2`."""

    def __init__(self, axis: Float, sine: float, pattern: Float) -> None:
        self._axis, self._sine, self._pattern = axis, sine, pattern
        self._across, self._along = _tangents(axis)

    def at(self, rows: NDArray[np.intp]) -> Cone:
        """Return the cones about some of the axes."""
        return Cone(self._axis[rows], self._sine, self._pattern)

    def direction(self, k: int, spin: Float) -> Float:
        """Return direction `k` of the pattern in every cone (P, 3), the pattern turned by `spin` (P,) in 0..1."""
        radius, turn = self._sine * self._pattern[k, 0], self._pattern[k, 1]
        angle = np.float32(2.0 * np.pi) * (spin[:, None] + np.float32(turn))
        aside = np.float32(radius) * (np.cos(angle) * self._across + np.sin(angle) * self._along)
        return aside + np.float32(np.sqrt(1.0 - radius * radius)) * self._axis


def _tangents(normal: Float) -> tuple[Float, Float]:
    """Return two unit vectors (P, 3) that make a right-handed frame with each `normal` (P, 3).

    Source: Duff et al. 2017, Building an Orthonormal Basis, Revisited.
    """
    x, y, z = normal.T
    sign = np.where(z >= 0.0, np.float32(1.0), np.float32(-1.0))
    a = -1.0 / (sign + z)
    b = x * y * a
    across = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    along = np.stack([b, sign + y * y * a, -y], axis=1)
    return across.astype(np.float32), along.astype(np.float32)
