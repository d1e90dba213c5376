"""Layouts: places for the robot and the objects of N worlds, none nearer to another than their keepouts.

Things are placed one after the other, each uniformly in what its placement allows and the earlier ones leave free, as
in GUARD's engine. A world in which one of them finds no place is not thrown away, as it is there: everything but the
robot is drawn again, each time to where it overlaps least, until nothing overlaps.

Every world draws from its own stream, in blocks whose number depends on that world alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import SpecError
from guard_api.physics.transition import Snapshot
from guard_api.scene.area import COORDINATES, Area, Array, Item, Mask, Rectangle, distances, heights
from guard_api.scene.overlap import freest

Rows: TypeAlias = NDArray[np.intp]
Streams: TypeAlias = Sequence[np.random.Generator]
Stand: TypeAlias = Callable[[Array, Array], Snapshot]
"""Returns the robots as they stand at home, at places (n, 2) [m] and headings (n,) [rad]."""

_TRIES: Final = 100
"""Candidates of each item in turn, as in GUARD."""

_FIRST: Final = 12
"""How many of them are looked at before the others are, in worlds where none of these is free."""

_MOVES: Final = 8
"""Candidates anywhere for an item that is drawn again, and as many around it; each sweep looks at as many more."""

_NEAREST, _FURTHEST = 0.02, 1.0
"""[m] How far those around it may be: the bound itself is drawn, uniform in its logarithm."""

_SWEEPS: Final = 8
"""Times that all items are drawn again before a layout is given up."""

_LAYOUTS: Final = 400
"""Layouts given up before a world counts as impossible."""

_PROBES, _PROBE_LAYOUTS = 8, 40
"""Worlds tried when a sampler is built, and layouts given up in them: stricter, so that no episode fails later."""

_TOGETHER: Final = 256
"""Worlds that are placed at once, which bounds the memory."""


class LayoutSampler:
    """Places `items`, of which the first is the robot, within `extents` or their own rectangles.

    Items with a location are there before all others. stand: how the robot stands, for items that depend on it.
    Raises SpecError when there is no room for them, with the numbers.
    """

    def __init__(self, items: Sequence[Item], extents: Rectangle, stand: Stand | None = None) -> None:
        self.items, self._extents = tuple(items), extents
        keepout = np.array([item.keepout for item in items])
        keeps = keepout > 0.0
        located = np.array([item.location is not None for item in items])
        apart = keeps[:, None] & keeps & ~(located[:, None] & located) & ~np.eye(len(items), dtype=bool)
        self._squared_reach = np.where(apart, (keepout[:, None] + keepout) ** 2, 0.0)
        self._areas: dict[int, Area] = {}
        self._blocks: list[tuple[Area, slice]] = []
        free = [i for i, item in enumerate(items) if item.location is None]
        for _, equal in groupby(free, key=lambda i: self.items[i]):
            rows = list(equal)
            area = Area(self.items[rows[0]], extents)
            self._areas |= dict.fromkeys(rows, area)
            self._blocks.append((area, slice(rows[0], rows[-1] + 1)))
        self._stand = stand if any(area.sees_robot for area in self._areas.values()) else None
        self._check_room()
        probes = [np.random.default_rng(probe) for probe in range(_PROBES)]
        self._sample(probes, np.zeros(_PROBES), _PROBE_LAYOUTS)

    def sample(self, streams: Streams, yaw: Array) -> Array:
        """Return the places of all items in one world per stream: (n, items, 3) [m].

        yaw: (n,) headings of the robots [rad]. Raises SpecError when a world finds no layout.
        """
        places = np.empty((len(streams), len(self.items), 3))
        for first in range(0, len(streams), _TOGETHER):
            rows = slice(first, first + _TOGETHER)
            places[rows] = self._sample(streams[rows], yaw[rows], _LAYOUTS)
        return places

    def replace(self, index: int, places: Array, streams: Streams, robot: Snapshot) -> tuple[Array, Mask]:
        """Draw new places for item `index`, whatever its location, among the others' `places` (n, items, 3).

        robot: how it stands now in the n worlds.
        Returns the places (n, 3) and which worlds found one (n,); a world without one keeps its old place there.
        """
        area = self._areas.get(index) or Area(self.items[index], self._extents)
        result, pending = places[:, index].copy(), np.arange(len(places))
        for _ in range(_TRIES):
            points = area.candidates(_drawn(streams, pending, (_TRIES, COORDINATES)))
            allowed = area.allows(points, rows_of(robot, pending))
            best, least = freest(points, allowed, places[pending], self._squared_reach[index])
            result[pending[least == 0.0]] = best[least == 0.0]
            pending = pending[least > 0.0]
            if len(pending) == 0:
                break
        found = np.ones(len(places), dtype=bool)
        found[pending] = False
        return result, found

    def _sample(self, streams: Streams, yaw: Array, layouts: int) -> Array:
        """Return the places of all items (n, items, 3). Raises SpecError when a world gives up `layouts` of them."""
        places, pending = np.empty((len(streams), len(self.items), 3)), np.arange(len(streams))
        for _ in range(layouts):
            found, done = self._attempt([streams[i] for i in pending.tolist()], yaw[pending])
            places[pending[done]] = found[done]
            pending = pending[~done]
            if len(pending) == 0:
                return places
        raise SpecError(f"layout: no free places found in {layouts} layouts for {self._demand()}")

    def _attempt(self, streams: Streams, yaw: Array) -> tuple[Array, Mask]:
        """Return one layout for every stream (n, items, 3), and which of them hold (n,)."""
        places, robot, done = self._in_turn(streams, yaw)
        for sweep in range(1, _SWEEPS + 1):
            rows = np.flatnonzero(~done)
            if len(rows) == 0:
                break
            moving, standing = places[rows], rows_of(robot, rows)
            moves = 2 * _MOVES * sweep  # the fewer worlds are left, the more can be looked at in the same time
            self._sweep(moving, _drawn(streams, rows, (len(self.items), moves, COORDINATES)), standing)
            places[rows], done[rows] = moving, self._holds(moving, standing)
        return places, done

    def _in_turn(self, streams: Streams, yaw: Array) -> tuple[Array, Snapshot | None, Mask]:
        """Place all items in order, each at its first free candidate or, without one, where it overlaps least.

        Returns the places (n, items, 3), the robot if it matters, and in which worlds nothing overlaps (n,).
        """
        n, robot = len(streams), None
        every = np.arange(n)
        places, done = np.zeros((n, len(self.items), 3)), np.ones(n, dtype=bool)
        unit = _drawn(streams, every, (len(self.items), _TRIES, COORDINATES))
        placed = np.zeros(len(self.items), dtype=bool)
        for i, item in enumerate(self.items):
            if item.location is None:
                continue
            places[:, i, :2] = item.location
            places[:, i, 2] = heights(item.placement, item.height, unit[:, i, 0, 2])
            placed[i] = True
        for i, area in self._areas.items():
            if i > 0 and robot is None and self._stand is not None:
                robot = self._stand(places[:, 0, :2], yaw)
            rows, reach = every, np.where(placed, self._squared_reach[i], 0.0)
            for tries in (slice(_FIRST), slice(None)):
                points = area.candidates(unit[rows, i, tries])
                places[rows, i], least = freest(points, area.allows(points, rows_of(robot, rows)), places[rows], reach)
                rows = rows[least > 0.0]
                if len(rows) == 0:
                    break
            done[rows] = False
            placed[i] = True
        return places, robot, done

    def _sweep(self, places: Array, unit: Array, robot: Snapshot | None) -> None:
        """Draw each item but the robot again, from numbers `unit` (n, items, moves, 3); change `places` in place.

        It goes where it overlaps least among candidates anywhere, others around it, and where it is.
        """
        n, _, moves, _ = unit.shape
        points, allowed = np.empty((n, len(self.items), moves + 1, 3)), np.ones((n, len(self.items), moves + 1), bool)
        near = slice(moves // 2, -1)
        points[:, :, -1] = places
        points[:, :, near] = places[:, :, None] + _shift(unit[:, :, near.start :])
        for area, rows in self._blocks:
            points[:, rows, : near.start] = area.candidates(unit[:, rows, : near.start])
            allowed[:, rows, near] = area.contains(points[:, rows, near])
            asked = area.allows(points[:, rows].reshape(n, -1, 3), robot)
            if asked is not None:
                allowed[:, rows] &= asked.reshape(n, -1, moves + 1)
        for i in self._areas:
            if i > 0:
                places[:, i], _ = freest(points[:, i], allowed[:, i], places, self._squared_reach[i])

    def _holds(self, places: Array, robot: Snapshot | None) -> Mask:
        """Return in which worlds all keepouts and placements hold: (n,)."""
        x, y = places[..., 0], places[..., 1]
        dx, dy = x[:, :, None] - x[:, None], y[:, :, None] - y[:, None]
        holds = np.logical_and.reduce(dx * dx + dy * dy >= self._squared_reach, axis=(1, 2))
        for area, rows in self._blocks:
            asked = area.allows(places[:, rows], robot)
            if asked is not None:
                holds &= asked.all(axis=1)
        return holds

    def _check_room(self) -> None:
        """Raise SpecError when the discs of the keepouts are larger than all areas together."""
        discs = sum(np.pi * self.items[i].keepout ** 2 for i in self._areas)
        room = sum(abs((b - x) * (d - y)) for x, y, b, d in self._rectangles())
        if discs > room:
            raise SpecError(f"layout: there is no room for {self._demand()}")

    def _rectangles(self) -> set[Rectangle]:
        """Return every rectangle that something may be drawn in."""
        asked = (self.items[i].placement.rectangles or (self._extents,) for i in self._areas)
        return {rectangle for rectangles in asked for rectangle in rectangles}

    def _demand(self) -> str:
        """Return what is asked for, in numbers."""
        crowd = Counter((item.name, item.keepout, distances(item.placement)) for item in self.items)
        listed = ", ".join(f"{count} {name} {keepout:g}{asked}" for (name, keepout, asked), count in crowd.items())
        discs = sum(np.pi * item.keepout**2 for item in self.items)
        return (
            f"{len(self.items)} items in {', '.join(map(str, sorted(self._rectangles())))} with keepouts [m] {listed}, "
            f"which are discs of {discs:.1f} m^2: use fewer objects, smaller keepouts and distances or larger extents"
        )


def rows_of(robot: Snapshot | None, rows: Rows) -> Snapshot | None:
    """Return the robots of the worlds `rows` (m,), in the fields that tell how they stand."""
    if robot is None:
        return None
    start, end = robot.segment_start[rows], robot.segment_end[rows]
    return replace(robot, position=robot.position[rows], segment_start=start, segment_end=end)


def _drawn(streams: Streams, rows: Rows, shape: tuple[int, ...]) -> Array:
    """Return numbers in [0, 1) from the streams of the worlds `rows` (m,): (m, *shape)."""
    drawn = np.empty((len(rows), *shape))
    for row, i in enumerate(rows.tolist()):
        streams[i].random(out=drawn[row])
    return drawn


def _shift(unit: Array) -> Array:
    """Map numbers in [0, 1) `unit` (..., 3) to shifts in the plane (..., 3) [m]."""
    bound = _NEAREST * (_FURTHEST / _NEAREST) ** unit[..., 2]
    return np.stack([bound * (2 * unit[..., 0] - 1), bound * (2 * unit[..., 1] - 1), np.zeros_like(bound)], axis=-1)
