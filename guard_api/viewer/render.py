"""Parts, floor and camera in, pixels out: ray casting on the CPU, the same bits on every call.

Embree finds what rays meet; the light is worked out here. No display, no GPU, no engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api.viewer.camera import Camera
from guard_api.viewer.ground import Ground
from guard_api.viewer.light import Lamps
from guard_api.viewer.parts import Part
from guard_api.viewer.surfaces import joined
from guard_api.viewer.tracer import FAR, Tracer

Float = NDArray[np.floating]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]

SUBPIXELS: Final = ((0.125, 0.625), (0.375, 0.125), (0.625, 0.875), (0.875, 0.375))
"""Where the rays of a pixel pass through it: a turned grid, which smooths near-horizontal and -vertical edges best."""

HORIZON: Final = np.array([0.80, 0.85, 0.90], np.float32)
ZENITH: Final = np.array([0.42, 0.57, 0.76], np.float32)
"""Light of the sky, low and straight up."""

BLOCK: Final = 16384
"""Pixels worked on at a time: few enough for the processor's cache."""

HAZE: Final = 9.0
"""Camera distances after which the floor has faded into the horizon by 63 %."""

LAYERS: Final = 12
"""Translucent surfaces that are looked through, one behind the other."""


def render(parts: Sequence[Part], ground: Ground | None, camera: Camera, size: tuple[int, int]) -> Image:
    """Return the picture (height, width, 3) that `camera`, framed, takes of `parts` on `ground`."""
    return _Picture(parts, ground, camera, size).taken()


class _Picture:
    def __init__(self, parts: Sequence[Part], ground: Ground | None, camera: Camera, size: tuple[int, int]) -> None:
        self._ground, self._camera, self._size = ground, camera, size
        solid, clear = _split(parts)
        surface, glass = joined(solid), joined(clear)
        self._solid, self._solid_colour = Tracer(surface), _colours(solid)[surface.owner]
        self._clear, self._clear_colour = Tracer(glass), _colours(clear)[glass.owner]
        self._lamps = Lamps(surface, self._solid)

    def taken(self) -> Image:
        width, height = self._size
        image = np.empty((height * width, 3), np.uint8)
        for first in range(0, len(image), BLOCK):
            pixel = np.arange(first, min(first + BLOCK, len(image)))
            image[pixel] = self._block((pixel % width).astype(np.float32), (pixel // width).astype(np.float32))
        return image.reshape(height, width, 3)

    def _block(self, column: Float, row: Float) -> Image:
        """Return the colours (P, 3) of the pixels at `column`, `row` (P,)."""
        spin = _interleaved(column, row)
        shown = np.zeros((len(column), 3), np.float32)
        for i, (x, y) in enumerate(SUBPIXELS):
            place, direction = self._camera.rays(column + np.float32(x), row + np.float32(y), self._size)
            start = np.repeat(place[None], len(direction), axis=0)
            # Brightness is compressed before averaging: an edge between bright and dark is otherwise a staircase.
            shown += _display(self._seen(start, direction, spin, i))
        return (shown * (255.0 / len(SUBPIXELS)) + 0.5).astype(np.uint8)

    def _seen(self, start: Float, direction: Float, spin: Float, turn: int) -> Float:
        """Return the light (P, 3) that comes from along `direction` (P, 3) to `start` (P, 3)."""
        hits = self._solid.first(start, direction)
        down = np.where(direction[:, 2] < 0.0, -start[:, 2] / np.minimum(direction[:, 2], -1e-9), FAR)
        on_floor = (down < hits.distance) & (down > 0.0) if self._ground is not None else np.zeros(len(down), bool)
        distance = np.where(on_floor, down, hits.distance).astype(np.float32)
        light = _sky(direction)
        met = np.flatnonzero(distance < FAR)
        point = start[met] + distance[met, None] * direction[met]
        colour, normal = self._surface_at(point, hits.face[met], hits.normal[met], on_floor[met])
        shaded = self._lamps.shade(point, normal, colour, direction[met], spin[met], turn, on_floor[met])
        fade = np.exp(-distance[met] / np.float32(HAZE * (self._camera.distance or 1.0)))[:, None]
        light[met] = fade * shaded + (1 - fade) * HORIZON
        return self._through(start, direction, distance, light)

    def _surface_at(self, point: Float, face: NDArray[np.int32], normal: Float, on_floor: Mask) -> tuple[Float, Float]:
        """Return reflectance and normal (P, 3) each of points (P, 3) on `face` (P,) with `normal`, or on the floor."""
        colour = np.empty_like(point)
        solid, floor = np.flatnonzero(~on_floor), np.flatnonzero(on_floor)
        colour[solid] = self._solid_colour[face[solid], :3]
        if self._ground is not None:
            colour[floor] = self._ground.reflectance(point[floor, 0], point[floor, 1])
            normal[floor] = (0.0, 0.0, 1.0)
        return colour, normal

    def _through(self, start: Float, direction: Float, distance: Float, light: Float) -> Float:
        """Return `light` (P, 3) as it looks through the translucent parts before `distance` (P,)."""
        clearness = np.ones((len(start), 1), np.float32)
        added = np.zeros_like(light)
        rays, travelled = np.arange(len(start)), np.zeros(len(start), np.float32)
        for _ in range(LAYERS):
            origin = start[rays] + (travelled + np.float32(1e-4))[:, None] * direction[rays]
            hits = self._clear.first(origin, direction[rays])
            travelled = travelled + np.float32(1e-4) + hits.distance
            met = travelled < distance[rays]
            rays, travelled = rays[met], travelled[met]
            if not len(rays):
                break
            colour, normal = self._clear_colour[hits.face[met]], hits.normal[met]
            alpha = colour[:, 3:]
            glow = colour[:, :3] * (np.float32(0.75) + np.float32(0.25) * normal[:, 2:])
            added[rays] += clearness[rays] * alpha * glow
            clearness[rays] *= 1 - alpha
        return added + clearness * light


def _split(parts: Sequence[Part]) -> tuple[list[Part], list[Part]]:
    """Return the solid and the translucent ones of `parts`; what is fully transparent is left out."""
    return [p for p in parts if p.rgba[3] >= 1.0], [p for p in parts if 0.0 < p.rgba[3] < 1.0]


def _colours(parts: Sequence[Part]) -> Float:
    """Return the linear reflectance and opacity of `parts` (P, 4), whose colours are as screens show them."""
    rgba = np.array([part.rgba for part in parts], np.float32).reshape(-1, 4)
    rgba[:, :3] = rgba[:, :3] ** np.float32(2.2)
    return rgba


def _interleaved(column: Float, row: Float) -> Float:
    """Return a value in 0..1 for every pixel such that neighbours differ evenly: noise that does not look like noise.

    Source: Jimenez 2014, interleaved gradient noise.
    """
    return np.float32(52.9829189) * ((0.06711056 * column + 0.00583715 * row) % 1.0) % 1.0


def _sky(direction: Float) -> Float:
    high = np.clip(direction[:, 2:], 0.0, 1.0) ** np.float32(0.6)
    return HORIZON + high * (ZENITH - HORIZON)


def _display(light: Float) -> Float:
    """Return linear light as the sRGB values in 0..1 that a screen turns back into it."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** np.float32(1 / 2.4) - 0.055).astype(np.float32)
