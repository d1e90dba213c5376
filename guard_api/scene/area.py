"""Where one thing may be put, whatever else there is: candidates, and which of them its placement allows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import SpecError
from guard_api.physics.transition import Snapshot
from guard_api.scene.spec import Placement

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rectangle = tuple[float, float, float, float]

COORDINATES: Final = 3
"""Numbers in [0, 1) that one candidate is made from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One thing to place: `keepout` is the radius kept free around it [m], `height` its z without `heights` [m].

    Things of keepout 0 are marks: they keep nothing free, and nothing keeps clear of them.
    location: (x, y) [m] where it stands, whatever else there is; None lets it be drawn.
    """

    name: str
    keepout: float
    height: float = 0.0
    placement: Placement = field(default_factory=Placement)
    location: tuple[float, float] | None = None


class Area:
    """The rectangles in which an item's centre may be, uniformly: shrunk by its keepout, chosen by their size.

    Raises SpecError, with the numbers, when nothing is left of them or no place in them has the distance from the
    origin that is asked for.
    """

    def __init__(self, item: Item, extents: Rectangle) -> None:
        self._name, self._placement, self._height = item.name, item.placement, item.height
        given = np.array(item.placement.rectangles or (extents,), dtype=np.float64)
        size = given[:, 2:] - given[:, :2] - 2 * item.keepout
        fits = (size >= -1e-9).all(axis=1)
        if not fits.any():
            width = float((given[:, 2:] - given[:, :2]).min(axis=1).max())
            raise SpecError(
                f"layout: {item.name} keeps {item.keepout} m free on every side, but the placement area "
                f"{_listed(given)} is only {width:g} m wide: enlarge it or lower keepout"
            )
        self._low, self._size = given[fits, :2] + item.keepout, np.maximum(size[fits], 0.0)
        surface = self._size.prod(axis=1)
        share = surface / surface.sum() if surface.any() else np.full(len(surface), 1.0 / len(surface))
        self._bound = np.concatenate([[0.0], share.cumsum()])
        self._check_radius()

    @property
    def sees_robot(self) -> bool:
        """Whether it depends on how the robot stands."""
        return self._placement.clearance > 0.0 or self._placement.apart > 0.0

    def candidates(self, unit: Array) -> Array:
        """Map numbers in [0, 1) `unit` (..., 3) to centres (..., 3) [m], uniform in the rectangles and heights."""
        x, y = unit[..., 0], unit[..., 1]
        if len(self._low) == 1:
            low, size = self._low[0], self._size[0]
        else:  # The first number chooses the rectangle; what is left of it is uniform again.
            chosen = np.minimum(np.searchsorted(self._bound, x, side="right") - 1, len(self._low) - 1)
            x = (x - self._bound[chosen]) / (self._bound[chosen + 1] - self._bound[chosen])
            low, size = self._low[chosen], self._size[chosen]
        points = np.empty(unit.shape)
        points[..., 0] = low[..., 0] + x * size[..., 0]
        points[..., 1] = low[..., 1] + y * size[..., 1]
        points[..., 2] = heights(self._placement, self._height, unit[..., 2])
        return points

    def contains(self, points: Array) -> Mask:
        """Return which `points` (..., 3) lie in a rectangle: (...)."""
        x, y, inside = points[..., 0], points[..., 1], np.zeros(points.shape[:-1], dtype=bool)
        for (left, low), (right, high) in zip(self._low, self._low + self._size, strict=True):
            inside |= (x >= left) & (x <= right) & (y >= low) & (y <= high)
        return inside

    def allows(self, points: Array, robot: Snapshot | None) -> Mask | None:
        """Return which `points` (n, k, 3) have the distances asked for, or None where none is asked for.

        robot: how it stands in the n worlds; None where no item depends on that.
        """
        near, far = self._placement.radius
        tests = []
        if near > 0.0 or np.isfinite(far):
            radius = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
            tests.append((radius >= near) & (radius <= far))
        if np.isfinite(self._placement.distance):
            tests.append((points * points).sum(axis=-1) <= self._placement.distance**2)
        if robot is not None and self._placement.clearance > 0.0:
            tests.append(robot.distance(points) >= self._placement.clearance)
        if robot is not None and self._placement.apart > 0.0:
            offset = points - robot.position[:, None]
            tests.append((offset * offset).sum(axis=-1) >= self._placement.apart**2)
        return np.logical_and.reduce(tests) if tests else None

    def _check_radius(self) -> None:
        """Raise SpecError when the rectangles have no point at the distances from the origin that are asked for."""
        high = self._low + self._size
        nearest = np.sqrt((np.clip(0.0, self._low, high) ** 2).sum(axis=1)).min()
        furthest = np.sqrt((np.maximum(np.abs(self._low), np.abs(high)) ** 2).sum(axis=1)).max()
        low = self._height if self._placement.heights is None else float(np.clip(0.0, *self._placement.heights))
        least, most = self._placement.radius
        where = f"but its places are {nearest:.4g} to {furthest:.4g} m from it"
        if least > furthest or most < nearest:
            raise SpecError(f"layout: {self._name} is asked for {least} to {most} m from the origin, {where}")
        if np.hypot(max(nearest, least), low) > self._placement.distance:
            raise SpecError(
                f"layout: {self._name} is asked for at most {self._placement.distance} m from the origin in space, "
                f"{where} in the plane and at least {low:g} m high"
            )


def heights(placement: Placement, height: float, unit: Array) -> Array:
    """Map numbers in [0, 1) to heights [m] of the centre; without `Placement.heights` to `height`."""
    if placement.heights is None:
        return np.full(unit.shape, height)
    low, high = placement.heights
    return low + unit * (high - low)


def distances(placement: Placement) -> str:
    """Return the distances [m] that a placement asks for in brackets, nothing when there are none."""
    usual = Placement()
    asked = {name: getattr(placement, name) for name in ("radius", "distance", "clearance", "apart")}
    listed = [f"{name} {value}" for name, value in asked.items() if value != getattr(usual, name)]
    return f" ({', '.join(listed)})" if listed else ""


def _listed(rectangles: Array) -> str:
    return ", ".join(str(tuple(float(x) for x in rectangle)) for rectangle in rectangles)
