"""Ghosts: zones or solid bodies that follow the robot. Source: GUARD (Zhao et al. 2023), sec. 5.3, eq. 10."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import NOT_NEGATIVE, POSITIVE, THRESHOLD
from guard_api.scene.motion import advanced, away_from_neighbours, towards
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Cylinder, Sphere


@dataclass(frozen=True, slots=True, kw_only=True)
class Ghosts:
    """`count` discs of radius `size` [m], or balls where `heights` (low, high) [m] are given, that follow the robot.

    They approach at `speed` [m/s] until they are `respect` [m] from the robot's reference, keep 2 `size` apart, and
    return when they are further than `travel` [m] from the origin. Trespassable ghosts cost their depth
    (`Snapshot.depth`); `solid` ones push, and cost 1 for each that touches the robot. Both times `weight`.
    """

    count: int
    size: float = field(default=0.3, metadata=POSITIVE)
    keepout: float = field(default=0.5, metadata=NOT_NEGATIVE)
    weight: float = field(default=1.0, metadata=NOT_NEGATIVE)
    speed: float = field(default=0.05, metadata=NOT_NEGATIVE)
    travel: float = field(default=2.5, metadata=THRESHOLD)
    respect: float = field(default=1.5, metadata=THRESHOLD)
    heights: tuple[float, float] | None = None
    solid: bool = False
    lidar: Lidar = field(default_factory=Lidar)

    @property
    def name(self) -> str:
        """Name of the cost column and of the body group."""
        return "ghosts"

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the ghosts, phantoms or driven bodies."""
        flat = self.heights is None
        half = self.size / 2 if self.solid else 0.01
        body = BodySpec(
            shape=Cylinder(radius=self.size, half_length=half) if flat else Sphere(radius=self.size),
            physics="driven" if self.solid else "phantom",
            height=half + 0.01,
            keepout=self.keepout,
            rgba=(1.0, 0.0, 0.5, 1.0 if self.solid else 0.25),
        )
        placement = Placement(heights=self.heights, clearance=0.0 if flat else self.size)
        return (BodyGroup(name=self.name, body=body, count=self.count, placement=placement),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return where the ghosts are `duration` [s] later."""
        position = now.bodies[self.name]
        home, far = towards(position, np.zeros((1, 1, 3)), spatial=False)
        robot, distance = towards(position, now.position[:, None], spatial=self.heights is not None)
        strayed = far > self.travel
        follows = ~strayed & (distance >= self.respect)
        direction = (
            away_from_neighbours(position, 2 * self.size) + strayed[..., None] * home + follows[..., None] * robot
        )
        return {self.name: advanced(position, self.speed * direction, duration, self.heights)}

    def cost(self, t: Transition) -> Array:
        """Return the summed depth [m] inside the ghosts, or how many touch: (N,)."""
        return self.weight * self._violation(t.now)

    def indicator(self, t: Transition) -> NDArray[np.bool_]:
        """Return whether the robot is inside a ghost or touches one: (N,)."""
        return self._violation(t.now) > 0.0

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `ghosts_lidar`."""
        return {"ghosts_lidar": self.lidar.read(t.now, t.now.bodies[self.name])}

    def _violation(self, now: Snapshot) -> Array:
        """Return the summed depth [m] inside the ghosts, or how many solid ones touch: (N,)."""
        if self.solid:
            return now.contact(self.name).sum(axis=1, dtype=float)
        return now.depth(now.bodies[self.name], self.size, spatial=self.heights is not None)
