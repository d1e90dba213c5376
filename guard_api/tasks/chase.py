"""Chase: stay close to targets that flee. Source: GUARD (Zhao et al. 2023), sec. 5.2, eq. 8, and its engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import FINITE
from guard_api.scene.spec import BodyGroup
from guard_api.tasks.targets import GROUP, Targets


@dataclass(frozen=True, slots=True, kw_only=True)
class Chase:
    """The reward of a step is what was gained on the nearest target [m], in space.

    Targets that do not see the robot stand still, those that do flee.
    """

    targets: Targets = field(default_factory=Targets)
    bonus: float = field(default=0.0, metadata=FINITE)

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the targets."""
        return (self.targets.group(),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return where the targets are `duration` [s] later."""
        return self.targets.move(now, duration, approach=0.0)

    def reward(self, t: Transition) -> Array:
        """Return by how much the distance to the nearest target fell: (N,) [m]."""
        return _nearest(t.previous) - _nearest(t.now)

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return nowhere: a chase has no end."""
        return np.zeros(len(t.action), dtype=bool)

    def respawn(self) -> None:
        """Return no group: targets move by themselves."""
        return

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `targets_lidar`."""
        return self.targets.observe(t.now)


def _nearest(now: Snapshot) -> Array:
    """Return the distance of the nearest target: (N,) [m]."""
    return now.distance(now.bodies[GROUP]).min(axis=1)
