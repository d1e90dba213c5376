"""Whether the physics lasts: an environment under random actions, and every world that it lost on the way."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from guard_api.env import make_environment
from guard_api.errors import SpecError


def measure_endurance(
    env: str, backend: str, *, total_steps: int, num_worlds: int, seed: int, workers: int | None = None
) -> dict[str, Any]:
    """Return what at least `total_steps` environment steps of `env` under uniform random actions met, as JSON data.

    failures: reason -> how many episodes it ended; a divergence of the physics is one. fastest: the greatest speed of
    a link after any step [m/s], infinite numbers aside: a world can explode without leaving the numbers.
    Raises SpecError for fewer than one step.
    """
    if total_steps < 1:
        raise SpecError(f"total_steps is {total_steps}: it must be at least 1")
    environment = make_environment(env, backend=backend, num_worlds=num_worlds, seed=seed, workers=workers)
    stream = np.random.default_rng(seed)
    failures: Counter[str] = Counter()
    fastest, episodes, steps = 0.0, 0, -(-total_steps // num_worlds)
    try:
        for _ in range(steps):
            step = environment.step(stream.uniform(-1.0, 1.0, (num_worlds, environment.action_size)))
            failures.update(step.failures.values())
            episodes += int((step.terminated | step.truncated).sum())
            speed = np.linalg.norm(environment.snapshot.state.link_linear_velocity, axis=-1)
            fastest = max(fastest, float(speed.max()))
    finally:
        environment.close()
    return {"steps": steps * num_worlds, "episodes": episodes, "failures": dict(failures), "fastest": fastest}
