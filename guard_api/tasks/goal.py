"""Goal: drive to a disc on the floor or a ball in the air, then to the next one.

Source: GUARD (Zhao et al. 2023), sec. 5.2, and its engine.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition, planar_distance
from guard_api.scene.limits import FINITE, NOT_NEGATIVE, POSITIVE, whole
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.sensors.lidar import Lidar, compass
from guard_api.shapes import Cylinder, Sphere


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Reach a disc of radius `size` [m], or a ball where `heights` (low, high) [m] of its centre are given.

    The reward of a step is the distance gained [m], in the plane or in space, plus `bonus` on arrival, when the goal
    moves to a new free place. keepout: radius kept free around the goal when placed [m]. reach: the goal is placed at
    most this far from the origin in space [m], and a ball never where it is reached already. compass_axes: 2 or 3
    numbers in the compass. lidar: what observes the goal instead of the compass.
    """

    size: float = field(default=0.5, metadata=POSITIVE)
    keepout: float = field(default=0.4, metadata=NOT_NEGATIVE)
    bonus: float = field(default=1.0, metadata=FINITE)
    heights: tuple[float, float] | None = None
    reach: float = float("inf")
    compass_axes: int = field(default=2, metadata=whole(2, 3))
    lidar: Lidar | None = None

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the goal, a phantom."""
        flat = self.heights is None
        body = BodySpec(
            shape=Cylinder(radius=self.size, half_length=self.size / 2) if flat else Sphere(radius=self.size),
            physics="phantom",
            height=self.size / 2 + 0.01,
            keepout=self.keepout,
            rgba=(0.0, 1.0, 0.0, 0.25),
        )
        apart = 0.0 if flat else self.size
        placement = Placement(heights=self.heights, distance=self.reach, apart=apart)
        return (BodyGroup(name="goal", body=body, count=1, placement=placement),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: the goal stays until it is reached."""
        return {}

    def reward(self, t: Transition) -> Array:
        """Return the distance gained: (N,) [m]."""
        return self._distance(t.previous.position, t.now) - self._distance(t.now.position, t.now)

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return which worlds stand in the goal: (N,)."""
        return self._distance(t.now.position, t.now) <= self.size

    def respawn(self) -> str:
        """Return the goal's own group: a reached goal moves on."""
        return "goal"

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `goal_compass`, `compass_axes` numbers for every sensing frame, or `goal_lidar`."""
        if self.lidar is not None:
            return {"goal_lidar": self.lidar.read(t.now, t.now.bodies["goal"])}
        return {"goal_compass": compass(t.now, t.now.bodies["goal"][:, 0], self.compass_axes)}

    def _distance(self, position: Array, snapshot: Snapshot) -> Array:
        """Return the distance from `position` (N, 3) to the snapshot's goal: (N,) [m]."""
        goal = snapshot.bodies["goal"]
        if self.heights is None:
            return planar_distance(position, goal)[:, 0]
        x, y, z = (position - goal[:, 0]).T
        return np.sqrt(x * x + y * y + z * z)
