"""Hazards: discs on the floor, or balls in the air, that may be crossed, at a cost.

Source: GUARD (Zhao et al. 2023), sec. 5.3, and its engine.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import NOT_NEGATIVE, POSITIVE
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Cylinder, Sphere


@dataclass(frozen=True, slots=True, kw_only=True)
class Hazards:
    """`count` discs of radius `size` [m], or balls where `heights` (low, high) [m] are given.

    cost = weight * sum_i depth_i, how deep the robot is in each (`Snapshot.depth`).
    keepout: radius kept free around each hazard when placed [m]. reach: the most distance from the origin in the
    plane [m]. Balls are never placed on the robot.
    """

    count: int
    size: float = field(default=0.3, metadata=POSITIVE)
    keepout: float = field(default=0.4, metadata=NOT_NEGATIVE)
    weight: float = field(default=1.0, metadata=NOT_NEGATIVE)
    heights: tuple[float, float] | None = None
    reach: float = float("inf")
    lidar: Lidar = field(default_factory=Lidar)

    @property
    def name(self) -> str:
        """Name of the cost column and of the body group."""
        return "hazards"

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the hazards, phantoms."""
        flat = self.heights is None
        body = BodySpec(
            shape=Cylinder(radius=self.size, half_length=0.01) if flat else Sphere(radius=self.size),
            physics="phantom",
            height=0.02,
            keepout=self.keepout,
            rgba=(0.0, 0.0, 1.0, 0.25),
        )
        clearance = 0.0 if flat else self.size
        placement = Placement(radius=(0.0, self.reach), heights=self.heights, clearance=clearance)
        return (BodyGroup(name=self.name, body=body, count=self.count, placement=placement),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: hazards stay where they are."""
        return {}

    def cost(self, t: Transition) -> Array:
        """Return the summed depth inside the hazards: (N,) [m]."""
        return self.weight * self._depth(t.now)

    def indicator(self, t: Transition) -> NDArray[np.bool_]:
        """Return whether the robot is inside any hazard: (N,)."""
        return self._depth(t.now) > 0.0

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `hazards_lidar`."""
        return {f"{self.name}_lidar": self.lidar.read(t.now, t.now.bodies[self.name])}

    def _depth(self, now: Snapshot) -> Array:
        """Return the summed depth inside the hazards: (N,) [m]."""
        return now.depth(now.bodies[self.name], self.size, spatial=self.heights is not None)
