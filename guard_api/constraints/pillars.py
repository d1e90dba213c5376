"""Pillars: columns that stand in the way. Source: Ray et al. 2019 (Safety Gym), as in GUARD's engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import NOT_NEGATIVE, POSITIVE
from guard_api.scene.spec import BodyGroup, BodySpec
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Cylinder


@dataclass(frozen=True, slots=True, kw_only=True)
class Pillars:
    """`count` immovable cylinders of radius `size` and `height` [m]; the cost is `weight` for each that is touched."""

    count: int
    size: float = field(default=0.2, metadata=POSITIVE)
    height: float = field(default=1.0, metadata=POSITIVE)
    keepout: float = field(default=0.3, metadata=NOT_NEGATIVE)
    weight: float = field(default=1.0, metadata=NOT_NEGATIVE)
    lidar: Lidar = field(default_factory=Lidar)

    @property
    def name(self) -> str:
        """Name of the cost column and of the body group."""
        return "pillars"

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the pillars, static bodies."""
        half = self.height / 2
        body = BodySpec(
            shape=Cylinder(radius=self.size, half_length=half),
            physics="static",
            height=half,
            keepout=self.keepout,
            rgba=(0.5, 0.5, 1.0, 1.0),
        )
        return (BodyGroup(name=self.name, body=body, count=self.count),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: pillars stand."""
        return {}

    def cost(self, t: Transition) -> Array:
        """Return how many pillars the robot touched during the step: (N,)."""
        return self.weight * t.now.contact(self.name).sum(axis=1)

    def indicator(self, t: Transition) -> NDArray[np.bool_]:
        """Return whether the robot touched a pillar: (N,)."""
        return t.now.contact(self.name).sum(axis=1) > 0

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `pillars_lidar`."""
        return {"pillars_lidar": self.lidar.read(t.now, t.now.bodies[self.name])}
