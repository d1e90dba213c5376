"""Defense: keep targets out of a circle. Source: GUARD (Zhao et al. 2023), sec. 5.2, eq. 9, and its engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import FINITE, POSITIVE
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.shapes import Cylinder
from guard_api.tasks.targets import GROUP, Targets


@dataclass(frozen=True, slots=True, kw_only=True)
class Defense:
    """Targets head for the origin unless they see the robot; a circle of `radius` [m] around it is to be kept free.

    The reward of a step is the sum over the targets of 0.1 outside the circle, or rho / radius - 1 (from -1 at the
    centre to 0 at the border) at the distance rho inside it.
    """

    targets: Targets = field(default_factory=lambda: Targets(sight=2.0))
    radius: float = field(default=1.5, metadata=POSITIVE)
    bonus: float = field(default=0.0, metadata=FINITE)

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the targets and the circle, a phantom at the origin."""
        disc = Cylinder(radius=self.radius, half_length=0.005)
        body = BodySpec(shape=disc, physics="phantom", height=0.005, keepout=0.0, rgba=(0.0, 1.0, 0.0, 0.1))
        circle = BodyGroup(name="circle", body=body, count=1, placement=Placement(locations=((0.0, 0.0),)))
        return (self.targets.group(), circle)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return where the targets are `duration` [s] later."""
        return self.targets.move(now, duration, approach=self.targets.speed)

    def reward(self, t: Transition) -> Array:
        """Return how well the circle is defended: (N,)."""
        x, y = t.now.bodies[GROUP][..., 0], t.now.bodies[GROUP][..., 1]
        depth = np.sqrt(x * x + y * y) / self.radius - 1.0
        return np.where(depth < 0.0, depth, 0.1).sum(axis=1)

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return nowhere: a defense has no end."""
        return np.zeros(len(t.action), dtype=bool)

    def respawn(self) -> None:
        """Return no group: targets move by themselves."""
        return

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `targets_lidar`; the circle is not observed, as in GUARD."""
        return self.targets.observe(t.now)
