"""A small constrained task with a line that is not to be crossed: beyond it, costs are linear in place and action."""

from __future__ import annotations

import numpy as np

from guard_api.env import Step
from tests.algos.bandit import Fingerprint

LENGTH = 20
PACE = 0.2
"""Distance per step and unit of action [m]."""


class Corridor:
    """A point on a plane is paid for going to the right and up; to the right of x = `line` it costs (x - line).

    The action is clipped, as every environment does. The observation is the place. Best without costs: (1, 1) always.
    """

    spec, backend_name = Fingerprint("corridor"), "none"
    observation_size, action_size, episode_length = 2, 2, LENGTH
    cost_names = ("line", "spare")

    def __init__(self, num_worlds: int = 50, seed: int = 0, line: float = 1.0) -> None:
        self.num_worlds, self.seed, self.line = num_worlds, seed, line
        self.taken: list[np.ndarray] = []

    def reset(self, episode: int = 0, seed: int | None = None) -> np.ndarray:
        self.seed = self.seed if seed is None else seed
        self._episode, self._steps = episode, 0
        self._begin()
        return self._place.copy()

    def step(self, action: np.ndarray) -> Step:
        self._steps += 1
        self.taken.append(np.clip(action, -1, 1))
        self._place = self._place + PACE * self.taken[-1]
        final = self._place.copy()
        over = np.maximum(final[:, 0] - self.line, 0.0)
        ended = np.full(self.num_worlds, self._steps % LENGTH == 0)
        if ended.all():
            self._episode += 1
            self._begin()
        return Step(
            observation=self._place.copy(),
            reward=PACE * self.taken[-1].sum(axis=1),
            costs=np.stack([over, np.zeros_like(over)], axis=1),
            terminated=np.zeros_like(ended),
            truncated=ended,
            final_observation=final,
            success=np.zeros_like(ended),
            failures={},
        )

    def close(self) -> None:
        pass

    def _begin(self) -> None:
        rng = np.random.default_rng([self.seed, self._episode])
        self._place = rng.uniform(-0.5, 0.5, (self.num_worlds, 2))
