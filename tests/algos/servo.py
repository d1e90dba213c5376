"""A linear-quadratic constrained decision process, and its optimum by convex programming."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from guard_api.env import Step
from tests.algos.bandit import NOISE, Fingerprint

MEMORY = 0.5


class Servo:
    """A position y follows the action, y' = y / 2 + a / 2, from y uniform in [0, 1]; observed is y.

    Every step: reward 1 - (y' - 1)^2 + noise, costs scale a^2. Free of cost a = 1 would be best; a limit asks for less.
    The noise keeps the spread of the advantages, and so the unit of the multipliers, from vanishing with the policy's.
    """

    spec, backend_name = Fingerprint("servo"), "none"
    observation_size, action_size = 1, 1

    def __init__(self, num_worlds: int, episode_length: int, cost_scales: dict[str, float], seed: int = 0) -> None:
        self.num_worlds, self.episode_length, self.seed = num_worlds, episode_length, seed
        self.cost_names = tuple(cost_scales)
        self._scales = np.array(list(cost_scales.values()))

    def reset(self, episode: int = 0) -> np.ndarray:
        self._rng = np.random.default_rng([self.seed, episode])
        self._steps = 0
        self._position = self._start()
        return self._position[:, None].copy()

    def step(self, action: np.ndarray) -> Step:
        self._steps += 1
        ended = np.full(self.num_worlds, self._steps % self.episode_length == 0)
        self._position = MEMORY * self._position + (1 - MEMORY) * action[:, 0]
        final, noise = self._position[:, None].copy(), NOISE * self._rng.standard_normal(self.num_worlds)
        reward = 1 - (self._position - 1) ** 2 + noise
        if ended.all():
            self._position = self._start()
        return Step(
            observation=self._position[:, None].copy(),
            reward=reward,
            costs=action**2 * self._scales,
            terminated=np.zeros(self.num_worlds, bool),
            truncated=ended,
            final_observation=final,
            success=np.zeros(self.num_worlds, bool),
            failures={},
        )

    def close(self) -> None:
        pass

    def _start(self) -> np.ndarray:
        return self._rng.uniform(0, 1, self.num_worlds)


def optimum(length: int, limit: float) -> tuple[float, float]:
    """Return the largest mean episode return with a mean episode sum of a^2 of at most `limit`, and its multiplier.

    Over all policies: nothing is random but y_0, so for the multiplier m the best actions of an episode minimise
    |1 - h y_0 - G a|^2 + m |a|^2, linear in y_0, with y_1..T = h y_0 + G a; m is where the limit is met.
    """
    steps = np.arange(length)
    h = MEMORY ** (steps + 1.0)
    G = np.tril((1 - MEMORY) * MEMORY ** np.abs(steps[:, None] - steps))
    moments = np.array([[1, 1 / 2], [1 / 2, 1 / 3]])  # of (1, y_0), y_0 uniform in [0, 1]

    def at(multiplier: float) -> tuple[float, float]:
        K = np.linalg.solve(G.T @ G + multiplier * np.eye(length), G.T)
        target = np.stack([np.ones(length), -h], axis=1)
        actions, error = K @ target, target - G @ K @ target
        return length - float(np.sum(error @ moments * error)), float(np.sum(actions @ moments * actions))

    multiplier = float(brentq(lambda m: at(m)[1] - limit, 1e-6, 100.0))  # type: ignore[arg-type]
    return at(multiplier)[0], multiplier
