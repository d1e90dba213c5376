"""Circle: run along a circle. Source: Achiam et al. 2017, appendix; Ray et al. 2019 (Safety Gym)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import FINITE, POSITIVE
from guard_api.scene.spec import BodyGroup, BodySpec, Placement
from guard_api.sensors.lidar import Lidar
from guard_api.shapes import Cylinder


@dataclass(frozen=True, slots=True, kw_only=True)
class Circle:
    """Run counter-clockwise, fast and close to a circle of `radius` [m] around the origin.

    The reward of a step is scale * (v_t / (1 + |rho - radius|)), with v_t the tangential velocity [m/s] and rho the
    distance from the origin [m], in the plane.
    """

    radius: float = field(default=1.5, metadata=POSITIVE)
    scale: float = field(default=0.1, metadata=FINITE)
    bonus: float = field(default=0.0, metadata=FINITE)
    lidar: Lidar = field(default_factory=Lidar)

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the circle, a phantom at the origin."""
        disc = Cylinder(radius=self.radius, half_length=0.005)
        body = BodySpec(shape=disc, physics="phantom", height=0.005, keepout=0.0, rgba=(0.0, 1.0, 0.0, 0.1))
        return (BodyGroup(name="circle", body=body, count=1, placement=Placement(locations=((0.0, 0.0),))),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: the circle stays."""
        return {}

    def reward(self, t: Transition) -> Array:
        """Return the reward of running: (N,)."""
        (x, y), (u, v) = t.now.position[:, :2].T, t.now.linear_velocity[:, :2].T
        rho = np.sqrt(x * x + y * y)
        tangential = (x * v - y * u) / np.maximum(rho, 1e-9)
        return self.scale * tangential / (1.0 + np.abs(rho - self.radius))

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return nowhere: a circle has no end."""
        return np.zeros(len(t.action), dtype=bool)

    def respawn(self) -> None:
        """Return no group: nothing moves on."""
        return

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `circle_lidar`: where the centre is."""
        return {"circle_lidar": self.lidar.read(t.now, t.now.bodies["circle"])}
