"""The floor of a picture: squares of known size, and the line around the area that a scene is laid out in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.floating]
Extents: TypeAlias = tuple[float, float, float, float]

SQUARE = 0.5
"""Side of a square [m]: the scale of every picture."""

LINE = 0.015
"""Half the width of the line around the area [m]."""

LIGHT, DARK = 0.62, 0.50
"""Reflectance of the two kinds of square."""

INK = (0.10, 0.18, 0.26)
"""Reflectance of the line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The plane z = 0. extents: (xmin, ymin, xmax, ymax) [m] of the area to mark, or None."""

    extents: Extents | None = None

    def reflectance(self, x: Float, y: Float) -> Float:
        """Return the colour (P, 3) of the floor at `x`, `y` (P,) [m]."""
        even = (np.floor(x / SQUARE) + np.floor(y / SQUARE)) % 2 == 0
        grey = np.where(even, np.float32(LIGHT), np.float32(DARK))
        colour = np.repeat(grey[:, None], 3, axis=1)
        if self.extents is not None:
            xmin, ymin, xmax, ymax = self.extents
            outside = np.maximum(np.maximum(xmin - x, x - xmax), np.maximum(ymin - y, y - ymax))
            colour[outside > 0] *= np.float32(0.82)
            colour[np.abs(outside) < LINE] = INK
        return colour
