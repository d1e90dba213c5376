"""Targets that run: what Chase and Defense are about. Source: GUARD (Zhao et al. 2023), eq. 8-9, and its engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from guard_api.physics.transition import Array, Snapshot
from guard_api.scene.limits import NOT_NEGATIVE, POSITIVE, THRESHOLD, whole
from guard_api.scene.motion import advanced, away_from_neighbours, towards
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Cylinder, Sphere

GROUP = "targets"


@dataclass(frozen=True, slots=True, kw_only=True)
class Targets:
    """`count` discs on the floor, or balls in the air where `heights` (low, high) [m] are given.

    They keep 2 `size` [m] apart, return at `speed` [m/s] when they are further than `travel` [m] from the origin, and
    flee at `flight_speed` [m/s] from a robot nearer than `sight` [m]. solid: whether they push the robot.
    """

    count: int = field(default=2, metadata=whole(1))
    size: float = field(default=0.3, metadata=POSITIVE)
    keepout: float = field(default=0.5, metadata=NOT_NEGATIVE)
    speed: float = field(default=0.05, metadata=NOT_NEGATIVE)
    flight_speed: float = field(default=0.5, metadata=NOT_NEGATIVE)
    travel: float = field(default=2.0, metadata=THRESHOLD)
    sight: float = field(default=3.0, metadata=THRESHOLD)
    heights: tuple[float, float] | None = None
    solid: bool = False
    lidar: Lidar = field(default_factory=Lidar)

    def group(self) -> BodyGroup:
        """Return the targets, phantoms or driven bodies."""
        half = self.size / 2 if self.solid else 0.01
        body = BodySpec(
            shape=Sphere(radius=self.size) if self.heights else Cylinder(radius=self.size, half_length=half),
            physics="driven" if self.solid else "phantom",
            height=half + 0.01,
            keepout=self.keepout,
            rgba=(1.0, 1.0, 0.5, 1.0 if self.solid else 0.25),
        )
        return BodyGroup(name=GROUP, body=body, count=self.count, placement=Placement(heights=self.heights, last=True))

    def move(self, now: Snapshot, duration: float, *, approach: float) -> dict[str, Array]:
        """Return where the targets are `duration` [s] later.

        approach: speed [m/s] towards the origin, in the plane, of a target that does not see the robot.
        """
        position, spatial = now.bodies[GROUP], self.heights is not None
        home, far = towards(position, np.zeros((1, 1, 3)), spatial=False)
        chaser, distance = towards(position, now.position[:, None], spatial=spatial)
        strayed, seen = far > self.travel, distance <= self.sight
        inward = np.where(strayed, self.speed, np.where(seen, 0.0, approach))
        outward = np.where(~strayed & seen, self.flight_speed, 0.0)
        apart = self.speed * away_from_neighbours(position, 2 * self.size)
        velocity = apart + inward[..., None] * home - outward[..., None] * chaser
        return {GROUP: advanced(position, velocity, duration, self.heights)}

    def observe(self, now: Snapshot) -> dict[str, Array]:
        """Return `targets_lidar`."""
        return {f"{GROUP}_lidar": self.lidar.read(now, now.bodies[GROUP])}
