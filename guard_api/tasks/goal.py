"""Goal: drive to a disc on the floor, then to the next one.

Source: GUARD (Zhao et al. 2023), sec. 5.2, and its engine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.spec import BodyGroup, BodySpec
from guard_api.sensors.lidar import compass
from guard_api.shapes import Cylinder


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Reach a disc of radius `size` [m]; the distance counts in the plane.

    The reward of a step is the distance gained [m] plus `bonus` on arrival, when the goal moves to a new free place.
    keepout: radius kept free around the goal when placed [m]. compass_axes: 2 or 3 numbers in the compass.
    """

    size: float = 0.5
    keepout: float = 0.4
    bonus: float = 1.0
    compass_axes: int = 2

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the goal disc, a phantom."""
        disc = Cylinder(radius=self.size, half_length=self.size / 2)
        body = BodySpec(
            shape=disc,
            physics="phantom",
            height=self.size / 2 + 0.01,
            keepout=self.keepout,
            rgba=(0.0, 1.0, 0.0, 0.25),
        )
        return (BodyGroup(name="goal", body=body, count=1),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: the goal stays until it is reached."""
        return {}

    def reward(self, t: Transition) -> Array:
        """Return the distance gained: (N,) [m]."""
        return _distance(t.previous.position, t.now) - _distance(t.now.position, t.now)

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return which worlds stand in the goal: (N,)."""
        return _distance(t.now.position, t.now) <= self.size

    def respawn(self) -> str:
        """Return the goal's own group: a reached goal moves on."""
        return "goal"

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `goal_compass` (N, compass_axes): the direction of the goal in robot axes."""
        return {"goal_compass": compass(t.now, t.now.bodies["goal"][:, 0], self.compass_axes)}


def _distance(position: Array, snapshot: Snapshot) -> Array:
    """Return the distance in the plane from `position` (N, 3) to the snapshot's goal: (N,) [m]."""
    goal = snapshot.bodies["goal"]
    x, y = position[:, 0] - goal[:, 0, 0], position[:, 1] - goal[:, 0, 1]
    return np.sqrt(x * x + y * y)
