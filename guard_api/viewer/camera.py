"""Where a picture is taken from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from guard_api.shapes import Vector3
from guard_api.viewer.tracer import unit

Array = NDArray[np.float64]
Float = NDArray[np.floating]


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A camera that looks at `target` (3,) [m] from `distance` [m]; what is None is chosen so that all is in view.

    azimuth: direction from the target to the camera in the plane [rad], 0 is +x, turning to +y.
    elevation: of the camera above the plane [rad]. field_of_view: vertical [rad]. margin: how many times further away
    than it must a camera stands whose distance is chosen.
    """

    target: Vector3 | None = None
    distance: float | None = None
    azimuth: float = float(np.radians(-55.0))
    elevation: float = float(np.radians(28.0))
    field_of_view: float = float(np.radians(30.0))
    margin: float = 1.25

    @property
    def axes(self) -> Array:
        """The camera's axes right, up and back as rows (3, 3), world axes."""
        ca, sa, ce, se = np.cos(self.azimuth), np.sin(self.azimuth), np.cos(self.elevation), np.sin(self.elevation)
        return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])

    def framing(self, points: Array, aspect: float) -> Camera:
        """Return this camera with target and distance such that `points` (P, 3) [m] fill the picture.

        aspect: width of the picture over its height. What the user has fixed stays.
        """
        seen = points @ self.axes.T if len(points) else np.zeros((1, 3))
        side, depth = seen[:, :2], seen[:, 2:]
        slope = np.tan(0.5 * self.field_of_view) * np.array([aspect, 1.0])
        # A point is in view when |side - centre| <= slope (distance - depth): linear in both unknowns.
        upper, lower = (side + slope * depth).max(axis=0), (side - slope * depth).min(axis=0)
        centre = np.append(0.5 * (upper + lower), 0.5 * (depth.min() + depth.max()))
        if self.target is not None:
            centre = self.axes @ self.target
        needed = (np.maximum(upper - centre[:2], centre[:2] - lower) / slope).max() - centre[2]
        distance = self.margin * max(float(needed), 0.1) if self.distance is None else self.distance
        if self.target is None:
            centre[:2] = _middle(side, distance + centre[2] - depth, centre[:2])
        x, y, z = (float(value) for value in centre @ self.axes)
        return replace(self, target=(x, y, z), distance=distance)

    def rays(self, column: Float, row: Float, size: tuple[int, int]) -> tuple[Float, Float]:
        """Return the camera's place (3,) and the unit directions (P, 3) through picture points.

        column, row: (P,) [pixel] from the upper left corner. size: (width, height) of the picture.
        Raises ValueError where the target or distance is still open.
        """
        if self.target is None or self.distance is None:
            raise ValueError("a camera without target or distance must be framed first")
        width, height = size
        scale = np.float32(2.0 * np.tan(0.5 * self.field_of_view) / height)
        right, up, back = self.axes.astype(column.dtype)
        x, y = (column - 0.5 * width) * scale, (0.5 * height - row) * scale
        direction = unit(x[:, None] * right + y[:, None] * up - back)
        return (np.asarray(self.target) + self.distance * back).astype(np.float32), direction


def _middle(side: Array, ahead: Array, centre: Array) -> Array:
    """Return `centre` (2,) moved until points at `side` (P, 2), `ahead` (P, 1) of the camera, are seen about it."""
    for _ in range(6):  # Newton's method on a piecewise hyperbolic function: exact once the outermost points are found
        seen = (side - centre) / ahead
        first, last = seen.argmin(axis=0), seen.argmax(axis=0)
        slope = 1.0 / ahead[first, 0] + 1.0 / ahead[last, 0]
        centre = centre + (seen.min(axis=0) + seen.max(axis=0)) / slope
    return centre
