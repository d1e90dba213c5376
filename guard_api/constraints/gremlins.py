"""Gremlins: boxes that run in circles and push. Source: Ray et al. 2019 (Safety Gym), as in GUARD's engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import NOT_NEGATIVE, POSITIVE
from guard_api.scene.spec import BodyGroup, BodySpec
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Box


@dataclass(frozen=True, slots=True, kw_only=True)
class Gremlins:
    """`count` cubes of half width `size` [m] on circles of radius `travel` [m] around where they were placed.

    They turn once in `period` [s], all in phase. They start at the centre and run to the circle at no more than twice
    their later speed, instead of jumping there. The cost is `weight` for each that touches the robot.
    """

    count: int
    size: float = field(default=0.1, metadata=POSITIVE)
    keepout: float = field(default=0.5, metadata=NOT_NEGATIVE)
    travel: float = field(default=0.3, metadata=NOT_NEGATIVE)
    period: float = field(default=2.0 * np.pi, metadata=POSITIVE)
    weight: float = field(default=1.0, metadata=NOT_NEGATIVE)
    lidar: Lidar = field(default_factory=Lidar)

    @property
    def name(self) -> str:
        """Name of the cost column and of the body group."""
        return "gremlins"

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the gremlins, driven bodies."""
        r = self.size
        body = BodySpec(
            shape=Box(half_extents=(r, r, r)),
            physics="driven",
            height=r,
            keepout=self.keepout,
            rgba=(0.5, 0.0, 1.0, 1.0),
        )
        return (BodyGroup(name=self.name, body=body, count=self.count),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return where the gremlins are `duration` [s] later."""
        rate = 2.0 * np.pi / self.period
        phase = rate * (now.state.time[:, None] + duration)
        circle = now.origins[self.name].copy()
        circle[..., 0] += self.travel * np.sin(phase)
        circle[..., 1] += self.travel * np.cos(phase)
        step = circle - now.bodies[self.name]
        length = np.sqrt((step * step).sum(axis=-1, keepdims=True))
        most = 2.0 * rate * self.travel * duration
        return {self.name: now.bodies[self.name] + step * np.minimum(1.0, most / np.maximum(length, 1e-9))}

    def cost(self, t: Transition) -> Array:
        """Return how many gremlins touched the robot during the step: (N,)."""
        return self.weight * t.now.contact(self.name).sum(axis=1)

    def indicator(self, t: Transition) -> NDArray[np.bool_]:
        """Return whether a gremlin touched the robot: (N,)."""
        return t.now.contact(self.name).sum(axis=1) > 0

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `gremlins_lidar`."""
        return {"gremlins_lidar": self.lidar.read(t.now, t.now.bodies[self.name])}
