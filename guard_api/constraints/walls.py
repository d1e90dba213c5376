"""Walls: blocks that stand in the way. Source: Ray et al. 2019 (Safety Gym), as in GUARD's engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import NOT_NEGATIVE, POSITIVE
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Box


@dataclass(frozen=True, slots=True, kw_only=True)
class Walls:
    """`count` immovable cubes of half width `size` [m] at `locations`, or at free places once those are used up.

    The cost is `weight` for each that is touched; GUARD's walls cost nothing.
    """

    count: int
    size: float = field(default=0.5, metadata=POSITIVE)
    keepout: float = field(default=0.7, metadata=NOT_NEGATIVE)
    weight: float = field(default=1.0, metadata=NOT_NEGATIVE)
    locations: tuple[tuple[float, float], ...] = ()
    lidar: Lidar = field(default_factory=Lidar)

    @property
    def name(self) -> str:
        """Name of the cost column and of the body group."""
        return "walls"

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the walls, static bodies."""
        r = self.size
        body = BodySpec(
            shape=Box(half_extents=(r, r, r)),
            physics="static",
            height=r,
            keepout=self.keepout,
            rgba=(0.5, 0.5, 0.5, 1.0),
        )
        placement = Placement(locations=self.locations)
        return (BodyGroup(name=self.name, body=body, count=self.count, placement=placement),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: walls stand."""
        return {}

    def cost(self, t: Transition) -> Array:
        """Return how many walls the robot touched during the step: (N,)."""
        return self.weight * t.now.contact(self.name).sum(axis=1)

    def indicator(self, t: Transition) -> NDArray[np.bool_]:
        """Return whether the robot touched a wall: (N,)."""
        return t.now.contact(self.name).sum(axis=1) > 0

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `walls_lidar`."""
        return {"walls_lidar": self.lidar.read(t.now, t.now.bodies[self.name])}
