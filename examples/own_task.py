"""A task and a constraint of your own: two frozen dataclasses, no change to GUARD.

    python examples/own_task.py [mujoco | bullet | sapien]

To give them names, put `Visit = "your_package:Visit"` under the entry-point group `guard.tasks` of your package and
`Puddles = "your_package:Puddles"` under `guard.constraints`: then Visit_Point_3Puddles is an environment.
"""

# ruff: noqa: T201 - an example prints

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guard_api.constraints import Hazards
from guard_api.env import make_environment
from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.spec import BodyGroup, BodySpec
from guard_api.shapes import Cylinder
from guard_api.spec import EnvSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class Visit:
    """Be at a flag: the reward of a step is the time [s] spent within `radius` [m] of it, then it moves."""

    radius: float = 0.3
    bonus: float = 1.0

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the flag, which can be walked through."""
        pole = Cylinder(radius=0.05, half_length=0.5)
        return (BodyGroup(name="flag", body=BodySpec(shape=pole, physics="phantom", height=0.5), count=1),)

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return nothing: the flag stands."""
        return {}

    def reward(self, t: Transition) -> Array:
        """Return the time spent at the flag: (N,) [s]."""
        return t.duration * self.reached(t)

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return which worlds are at the flag: (N,)."""
        return np.linalg.norm(self._offset(t), axis=1) < self.radius

    def respawn(self) -> str:
        """Return the flag: it moves when it was reached."""
        return "flag"

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return where the flag is, in world axes: (N, 2) [m]."""
        return {"flag": self._offset(t)}

    def _offset(self, t: Transition) -> Array:
        return t.now.bodies["flag"][:, 0, :2] - t.now.position[:, :2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Puddles(Hazards):
    """Hazards that cost the speed [m/s] at which they are crossed, instead of depth."""

    @property
    def name(self) -> str:
        """Name of the cost column and of the body group."""
        return "puddles"

    def cost(self, t: Transition) -> Array:
        """Return the speed inside puddles: (N,) [m/s]."""
        return self.weight * self.indicator(t) * np.linalg.norm(t.now.linear_velocity, axis=1)


def main(backend: str) -> None:
    """Drive circles in the environment made of both."""
    spec = EnvSpec(name="visit", robot="point", task=Visit(), constraints=(Puddles(count=3),))
    env = make_environment(spec, backend=backend, num_worlds=32)
    env.reset()
    steps = [env.step(np.tile([1.0, 0.4], (32, 1))) for _ in range(500)]
    print("observation:", ", ".join(env.observation_layout))
    print("return:", np.sum([step.reward for step in steps], axis=0).mean().round(3))
    print("cost:", np.sum([step.costs for step in steps], axis=0).mean().round(3))
    env.close()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "mujoco")
