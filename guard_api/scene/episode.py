"""Where an episode starts: seeds, layout, headings and goals of every world, in neutral coordinates.

World i of an environment with seed s begins its episode e from the stream (s, i, e) alone: the same on every backend,
for any number of worlds, and whatever happened in earlier episodes. That pairs evaluations across backends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.state import Mask, Start
from guard_api.rotations import yaw_quaternion
from guard_api.scene.layout import Item, LayoutSampler
from guard_api.scene.spec import BodyGroup, SceneSpec
from guard_api.scene.start import home_start, place_robot

Array = NDArray[np.float64]


class EpisodeStarter:
    """Draws the starts of N worlds. Holds each world's stream, which also serves respawns during the episode."""

    def __init__(
        self,
        scene: SceneSpec,
        groups: Sequence[BodyGroup],
        extents: tuple[float, float, float, float],
        num_worlds: int,
    ) -> None:
        assert scene.robot is not None
        self._scene, self._robot, self._groups, self._num_worlds = scene, scene.robot, tuple(groups), num_worlds
        items = [Item(name="robot", keepout=scene.robot.keepout)]
        self._first_item: dict[str, int] = {}
        for group in groups:
            self._first_item[group.name] = len(items)
            items += [Item(name=group.name, keepout=group.body.keepout)] * group.count
        self._sampler = LayoutSampler(items=tuple(items), extents=extents)
        self._streams = [np.random.Generator(np.random.PCG64(0)) for _ in range(num_worlds)]
        self._sampler.sample(self._streams[:1])  # an impossible layout is refused here, not in the middle of a run

    def begin(self, mask: Mask, episodes: NDArray[np.int64], seed: int) -> tuple[Start, dict[str, Array]]:
        """Draw the starts of the masked worlds (N,) at their `episodes` (N,).

        Returns the `Start` of all worlds (rows outside the mask are meaningless) and the positions of every
        group's bodies, name -> (N, count, 3) [m].
        """
        worlds = np.flatnonzero(mask)
        for i in worlds:
            self._streams[i] = _stream(seed, int(i), int(episodes[i]))
        streams = [self._streams[i] for i in worlds]
        places = np.zeros((self._num_worlds, len(self._sampler.items), 2))
        yaws = np.zeros((self._num_worlds, len(self._sampler.items)))
        places[worlds] = self._sampler.sample(streams)
        yaws[worlds] = np.stack([stream.uniform(0.0, 2.0 * np.pi, len(self._sampler.items)) for stream in streams])

        start = place_robot(self._robot, home_start(self._scene, self._num_worlds), places[:, 0], yaws[:, 0])
        positions: dict[str, Array] = {}
        for group in self._groups:
            first = self._first_item[group.name]
            item = slice(first, first + group.count)
            positions[group.name] = _at_height(places[:, item], group.body.height)
            if group.body.physics != "phantom":
                bodies = self._scene.body_slice(group.name)
                start.body_position[:, bodies] = positions[group.name]
                start.body_quaternion[:, bodies] = yaw_quaternion(yaws[:, item])
        return start, positions

    def respawn(self, group: str, mask: Mask, robot: Array, positions: Mapping[str, Array]) -> tuple[Array, Mask]:
        """Draw a new place for the (single) body of `group` in the masked worlds (N,), free of everything there is now.

        robot: (N, 3) [m] where the robot is; positions: name -> (N, count, 3), every group as it is now.
        Returns the group's positions (N, 1, 3) and which worlds (N,) found no free place and keep the old one.
        """
        worlds = np.flatnonzero(mask)
        places = np.concatenate(
            [robot[worlds, None, :2], *(positions[g.name][worlds, :, :2] for g in self._groups)], axis=1
        )
        found, free = self._sampler.replace(self._first_item[group], places, [self._streams[i] for i in worlds])
        moved = positions[group].copy()
        moved[worlds, 0, :2] = found
        stuck = np.zeros(self._num_worlds, dtype=bool)
        stuck[worlds[~free]] = True
        return moved, stuck


def _stream(seed: int, world: int, episode: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(world, episode))))


def _at_height(places: Array, height: float) -> Array:
    """Return places (n, count, 2) lifted to `height` [m]: (n, count, 3)."""
    return np.concatenate([places, np.full((*places.shape[:2], 1), height)], axis=-1)
