"""Button: press the lit button, then the next one. Source: Ray et al. 2019 (Safety Gym), as in GUARD's engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import FINITE, POSITIVE, whole
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.sensors.lidar import Lidar, compass
from guard_api.shapes import Cylinder

BUTTONS = "buttons"
"""The group that the goal stands on: `guard_api.constraints.Buttons` places it, as a constraint or as scenery."""

_SAME_PLACE = 1e-3
"""Distance [m] below which goal and button are at one place: some engines keep places in float32."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Button:
    """Touch the button that the goal stands on; it then moves to another one.

    The reward of a step is the distance gained [m] in the plane, plus `bonus` for the press. lidar: what observes the
    goal instead of the compass.
    """

    size: float = field(default=0.2, metadata=POSITIVE)
    bonus: float = field(default=1.0, metadata=FINITE)
    compass_axes: int = field(default=2, metadata=whole(2, 3))
    lidar: Lidar | None = None

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the goal's marker, a phantom on one of the buttons."""
        disc = Cylinder(radius=self.size, half_length=self.size / 2)
        body = BodySpec(shape=disc, physics="phantom", height=self.size / 2, keepout=0.0, rgba=(0.0, 1.0, 0.0, 0.25))
        return (BodyGroup(name="goal", body=body, count=1, placement=Placement(onto=BUTTONS)),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: buttons stay."""
        return {}

    def reward(self, t: Transition) -> Array:
        """Return the distance gained: (N,) [m]."""
        return _distance(t.previous.position, t.now) - _distance(t.now.position, t.now)

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return which worlds pressed the goal's button: (N,)."""
        return (t.now.contact(BUTTONS) & lit(t.now)).sum(axis=1) > 0

    def respawn(self) -> str:
        """Return the goal's marker: it moves to another button."""
        return "goal"

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `goal_compass` or `goal_lidar`: where the goal's button is."""
        if self.lidar is not None:
            return {"goal_lidar": self.lidar.read(t.now, t.now.bodies["goal"])}
        return {"goal_compass": compass(t.now, t.now.bodies["goal"][:, 0], self.compass_axes)}


def lit(now: Snapshot) -> NDArray[np.bool_]:
    """Return which of the buttons the goal stands on: (N, count)."""
    offset = now.bodies[BUTTONS][..., :2] - now.bodies["goal"][..., :2]
    return (offset * offset).sum(axis=-1) < _SAME_PLACE**2


def _distance(position: Array, snapshot: Snapshot) -> Array:
    offset = position[:, :2] - snapshot.bodies["goal"][:, 0, :2]
    return np.sqrt((offset * offset).sum(axis=-1))
