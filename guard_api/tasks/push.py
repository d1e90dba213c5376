"""Push: bring a ball or a box to the goal. Source: GUARD (Zhao et al. 2023), sec. 5.2, and its engine."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.limits import FINITE, NOT_NEGATIVE, POSITIVE, THRESHOLD, whole
from guard_api.scene.spec import BodyGroup, BodySpec
from guard_api.sensors.lidar import Lidar, compass
from guard_api.shapes import Box, Cylinder, Sphere


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """Move the object to within `size` [m] of the centre of a disc on the floor, then to the next one.

    The reward of a step is what the object gained on the goal [m], plus what the robot gained on the object [m] while
    it is further away than `reach` [m]; distances in space. object_size: radius or half width [m].
    damping: [1/s] of the ball's motion, in place of a rolling friction of 0.05 m, which not every engine has. GUARD's
    ball, slowed by about 1.5 m/s^2, rolls 0.79 m from 1.5 m/s, Point's full speed; so does this one, at 1.9 1/s. A box
    slides instead. lidar: what observes goal and object instead of the compass.
    """

    object: Literal["ball", "box"] = "ball"
    object_size: float = field(default=0.2, metadata=POSITIVE)
    density: float = field(default=0.001, metadata=POSITIVE)
    damping: float = field(default=1.9, metadata=NOT_NEGATIVE)
    object_keepout: float = field(default=0.2, metadata=NOT_NEGATIVE)
    reach: float = field(default=0.4, metadata=THRESHOLD)
    size: float = field(default=0.5, metadata=POSITIVE)
    keepout: float = field(default=0.4, metadata=NOT_NEGATIVE)
    bonus: float = field(default=1.0, metadata=FINITE)
    compass_axes: int = field(default=2, metadata=whole(2, 3))
    lidar: Lidar | None = None

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the goal disc, a phantom, and the object, a dynamic body."""
        disc = Cylinder(radius=self.size, half_length=self.size / 2)
        goal = BodySpec(
            shape=disc,
            physics="phantom",
            height=self.size / 2 + 0.01,
            keepout=self.keepout,
            rgba=(0.0, 1.0, 0.0, 0.25),
        )
        r = self.object_size
        ball = self.object == "ball"
        pushed = BodySpec(
            shape=Sphere(radius=r) if ball else Box(half_extents=(r, r, r)),
            physics="dynamic",
            mass=self.density * (4 / 3 * np.pi * r**3 if ball else 8 * r**3),
            damping=self.damping if ball else 0.0,
            height=r,
            keepout=self.object_keepout,
            rgba=(1.0, 1.0, 0.0, 1.0),
        )
        return (BodyGroup(name="goal", body=goal, count=1), BodyGroup(name=self.object, body=pushed, count=1))

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: the object is moved by the physics."""
        return {}

    def reward(self, t: Transition) -> Array:
        """Return what was gained on the goal and on the object: (N,) [m]."""
        before, now = self._from_robot(t.previous), self._from_robot(t.now)
        approached = np.where(before > self.reach, before - now, 0.0)
        # The goal of the step's end counts at both ends: it may have moved before the step began.
        return approached + self._to_goal(t.previous, t.now) - self._to_goal(t.now, t.now)

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return in which worlds the object lies in the goal: (N,)."""
        return self._to_goal(t.now, t.now) <= self.size

    def respawn(self) -> str:
        """Return the goal's group: a reached goal moves on."""
        return "goal"

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return `goal_compass` and `ball_compass` or `box_compass`, or the two lidars of the same beginnings."""
        places = {name: t.now.bodies[name] for name in ("goal", self.object)}
        if self.lidar is not None:
            return {f"{name}_lidar": self.lidar.read(t.now, place) for name, place in places.items()}
        return {f"{name}_compass": compass(t.now, place[:, 0], self.compass_axes) for name, place in places.items()}

    def _from_robot(self, now: Snapshot) -> Array:
        """Return the distance of the object from the robot's reference: (N,) [m]."""
        return _norm(now.bodies[self.object][:, 0] - now.position)

    def _to_goal(self, now: Snapshot, goal: Snapshot) -> Array:
        """Return the distance of the object in `now` to the goal in `goal`: (N,) [m]."""
        return _norm(now.bodies[self.object][:, 0] - goal.bodies["goal"][:, 0])


def _norm(offset: Array) -> Array:
    return np.sqrt((offset * offset).sum(axis=-1))
