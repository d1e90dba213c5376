"""Where an episode starts: seeds, layout, headings and goals of every world, in neutral coordinates.

World i of an environment with seed s begins its episode e from the stream (s, i, e) alone: the same on every backend,
for any number of worlds, and whatever happened in earlier episodes. That pairs evaluations across backends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.state import Mask, Start
from guard_api.physics.transition import Snapshot
from guard_api.rotations import yaw_quaternion
from guard_api.scene.area import Item, heights
from guard_api.scene.layout import LayoutSampler, rows_of
from guard_api.scene.spec import BodyGroup, Placement, SceneSpec
from guard_api.scene.stance import HomeStance
from guard_api.scene.start import home_start, place_robot

Array = NDArray[np.float64]


class EpisodeStarter:
    """Draws the starts of N worlds. Holds each world's stream, which also serves respawns during the episode.

    robot_placement: where the robot may start. extents: (xmin, ymin, xmax, ymax) [m] of the placement area.
    Raises SpecError when the scene has no room for all of it, with the numbers.
    """

    def __init__(
        self,
        scene: SceneSpec,
        groups: Sequence[BodyGroup],
        extents: tuple[float, float, float, float],
        num_worlds: int,
        robot_placement: Placement | None = None,
    ) -> None:
        assert scene.robot is not None
        self._scene, self._robot, self._num_worlds = scene, scene.robot, num_worlds
        self._groups = {group.name: group for group in groups}
        items = _items("robot", scene.robot.keepout, 0.0, robot_placement or Placement(), 1)
        self._items: dict[str, slice] = {}
        for group in sorted(groups, key=lambda group: group.placement.last):
            if group.placement.onto is None:
                first = len(items)
                items += _items(group.name, group.body.keepout, group.body.height, group.placement, group.count)
                self._items[group.name] = slice(first, len(items))
        self._sampler = LayoutSampler(items, extents, HomeStance(scene))
        self._streams = [np.random.Generator(np.random.PCG64(0)) for _ in range(num_worlds)]
        self._robot_place = np.zeros((num_worlds, 2))

    def begin(self, mask: Mask, episodes: NDArray[np.int64], seed: int) -> tuple[Start, dict[str, Array]]:
        """Draw the starts of the masked worlds (N,) at their `episodes` (N,).

        Returns the `Start` of all worlds (rows outside the mask are meaningless) and the positions of every
        group's bodies, name -> (N, count, 3) [m].
        """
        worlds = np.flatnonzero(mask)
        for i in worlds:
            self._streams[i] = _stream(seed, int(i), int(episodes[i]))
        streams = [self._streams[i] for i in worlds]
        drawn = np.stack([stream.uniform(0.0, 2.0 * np.pi, len(self._sampler.items)) for stream in streams])
        places, yaw = np.zeros((self._num_worlds, *drawn.shape[1:], 3)), np.zeros((self._num_worlds, drawn.shape[1]))
        places[worlds], yaw[worlds] = self._sampler.sample(streams, drawn[:, 0]), drawn
        self._robot_place[worlds] = places[worlds, 0, :2]

        start = place_robot(self._robot, home_start(self._scene, self._num_worlds), places[:, 0, :2], yaw[:, 0])
        positions = {name: places[:, items] for name, items in self._items.items()}
        for name, group in self._groups.items():
            if group.placement.onto is not None:
                positions[name] = np.zeros((self._num_worlds, group.count, 3))
                positions[name][worlds] = self._onto(group, positions[group.placement.onto][worlds], streams)
        for group in self._scene.groups:
            bodies = self._scene.body_slice(group.name)
            start.body_position[:, bodies] = positions[group.name]
            if group.name in self._items:
                start.body_quaternion[:, bodies] = yaw_quaternion(yaw[:, self._items[group.name]])
        return start, positions

    def respawn(self, group: str, mask: Mask, now: Snapshot) -> tuple[Array, Mask]:
        """Draw a new place for the (single) body of `group` in the masked worlds (N,), free of everything there is now.

        Returns the group's positions (N, 1, 3) and which worlds (N,) found no free place and keep the old one.
        """
        worlds = np.flatnonzero(mask)
        streams = [self._streams[i] for i in worlds]
        moved, stuck = now.bodies[group].copy(), np.zeros(self._num_worlds, dtype=bool)
        onto = self._groups[group].placement.onto
        if onto is not None:
            taken = now.bodies[group][worlds]
            moved[worlds] = self._onto(self._groups[group], now.bodies[onto][worlds], streams, taken)
            return moved, stuck
        robot = self._robot_place if np.isfinite(self._robot.reach) else now.position[:, :2]
        places = np.zeros((len(worlds), len(self._sampler.items), 3))
        places[:, 0, :2] = robot[worlds]
        for name, items in self._items.items():
            places[:, items] = now.bodies[name][worlds]
        standing = rows_of(now, worlds)
        assert standing is not None
        moved[worlds, 0], found = self._sampler.replace(self._items[group].start, places, streams, standing)
        stuck[worlds[~found]] = True
        return moved, stuck

    @staticmethod
    def _onto(
        group: BodyGroup, bodies: Array, streams: Sequence[np.random.Generator], taken: Array | None = None
    ) -> Array:
        """Return `group.count` different ones of `bodies` (n, K, 3) at the group's heights: (n, count, 3).

        taken: (n, 1, 3) the place that is left, which is not drawn again if there is another.
        """
        places = np.empty((len(bodies), group.count, 3))
        for world, stream in enumerate(streams):
            order = stream.permutation(bodies.shape[1])
            if taken is not None:
                gap = bodies[world, order, :2] - taken[world, :, :2]
                order = order[np.argsort((gap * gap).sum(axis=-1) < 1e-12, kind="stable")]
            places[world] = bodies[world, order[: group.count]]
            places[world, :, 2] = heights(group.placement, group.body.height, stream.random(group.count))
        return places


def _items(name: str, keepout: float, height: float, placement: Placement, count: int) -> list[Item]:
    """Return `count` equal things, the first ones at the placement's locations."""
    located = [*placement.locations, *[None] * count][:count]
    return [
        Item(name=name, keepout=keepout, height=height, placement=placement, location=location) for location in located
    ]


def _stream(seed: int, world: int, episode: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(world, episode))))
