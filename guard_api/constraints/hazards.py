"""Hazards: discs on the floor that may be crossed, at a cost.

Source: GUARD (Zhao et al. 2023), sec. 5.3, and its engine.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.spec import BodyGroup, BodySpec
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Cylinder


@dataclass(frozen=True, slots=True, kw_only=True)
class Hazards:
    """`count` discs of radius `size` [m]; the cost of a step is how deep the robot's root is inside them.

    cost = weight * sum_i max(0, size - d_i), d_i the distance in the plane from the root link to hazard i [m].
    keepout: radius kept free around each hazard when placed [m].
    """

    count: int
    size: float = 0.3
    keepout: float = 0.4
    weight: float = 1.0
    lidar: Lidar = field(default_factory=Lidar)

    @property
    def name(self) -> str:
        """Name of the cost column and of the body group."""
        return "hazards"

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the hazard discs, phantoms."""
        disc = Cylinder(radius=self.size, half_length=0.01)
        body = BodySpec(shape=disc, physics="phantom", height=0.02, keepout=self.keepout, rgba=(0.0, 0.0, 1.0, 0.25))
        return (BodyGroup(name=self.name, body=body, count=self.count),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: hazards stay where they are."""
        return {}

    def cost(self, t: Transition) -> Array:
        """Return the summed depth inside the hazards: (N,) [m]."""
        places, robot = t.now.bodies[self.name], t.now.position
        x, y = places[..., 0] - robot[:, :1], places[..., 1] - robot[:, 1:2]
        return self.weight * np.maximum(self.size - np.sqrt(x * x + y * y), 0.0).sum(axis=1)

    def indicator(self, t: Transition) -> NDArray[np.bool_]:
        """Return whether the root is inside any hazard: (N,)."""
        return self.cost(t) > 0.0

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `hazards_lidar` (N, lidar.bins)."""
        return {"hazards_lidar": self.lidar.read(t.now, t.now.bodies[self.name])}
