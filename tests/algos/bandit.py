"""A small constrained decision problem with a known optimum, and a scripted one, with the environment's interface."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from guard_algos.policy import TrainedPolicy
from guard_api.algorithm import TrainingJob
from guard_api.env import Step
from guard_api.runs.directory import RunDirectory


@dataclass(frozen=True)
class Fingerprint:
    fingerprint: str = "bandit"


NOISE = 0.3


class Bandit:
    """Every step: reward 1 - (a - 1)^2 + noise, cost scale a^2; the observation is noise.

    With a narrow policy and a limit d on the mean cost per step (scale 1), the optimal mean is sqrt(d), the optimal
    reward 1 - (1 - sqrt(d))^2 and the multiplier 1 / sqrt(d) - 1, all per step.
    """

    spec, backend_name = Fingerprint(), "none"
    observation_size, action_size = 2, 1

    def __init__(self, num_worlds: int, episode_length: int, cost_scales: dict[str, float], seed: int = 0) -> None:
        self.num_worlds, self.episode_length, self.seed = num_worlds, episode_length, seed
        self.cost_names = tuple(cost_scales)
        self._scales = np.array(list(cost_scales.values()))

    def reset(self, episode: int = 0) -> np.ndarray:
        self._rng = np.random.default_rng([self.seed, episode])
        self._steps = 0
        return self._observe()

    def step(self, action: np.ndarray) -> Step:
        self._steps += 1
        ended = np.full(self.num_worlds, self._steps % self.episode_length == 0)
        observation = self._observe()
        return Step(
            observation=observation,
            reward=1 - (action[:, 0] - 1) ** 2 + NOISE * self._rng.standard_normal(self.num_worlds),
            costs=action**2 * self._scales,
            terminated=np.zeros(self.num_worlds, bool),
            truncated=ended,
            final_observation=observation,
            success=np.zeros(self.num_worlds, bool),
            failures={},
        )

    def close(self) -> None:
        pass

    def _observe(self) -> np.ndarray:
        return 0.1 * self._rng.standard_normal((self.num_worlds, 2))


class Script:
    """Plays back given arrays: reward (T, N), costs (T, N, C), terminated and truncated (T, N), success (T, N)."""

    spec, backend_name, seed = Fingerprint("script"), "none", 0
    observation_size, action_size = 1, 1

    def __init__(self, reward: Any, costs: Any, terminated: Any, truncated: Any, success: Any, names: tuple[str, ...]):
        self._reward, self._costs, self._success = (np.asarray(x, float) for x in (reward, costs, success))
        self._terminated, self._truncated = np.asarray(terminated, bool), np.asarray(truncated, bool)
        self.episode_length, self.num_worlds = self._reward.shape
        self.cost_names = names
        self.starts: list[int] = []
        self.actions: list[np.ndarray] = []

    def reset(self, episode: int = 0) -> np.ndarray:
        self.starts.append(episode)
        self._t = 0
        return np.zeros((self.num_worlds, 1))

    def step(self, action: np.ndarray) -> Step:
        t = self._t
        self._t += 1
        self.actions.append(action)
        ended = self._terminated[t] | self._truncated[t]
        final = np.full((self.num_worlds, 1), t + 1.0) + 0.1 * np.arange(self.num_worlds)[:, None]
        return Step(
            observation=np.where(ended[:, None], -1.0, final),
            reward=self._reward[t],
            costs=self._costs[t],
            terminated=self._terminated[t],
            truncated=self._truncated[t],
            final_observation=final,
            success=self._success[t] > 0,
            failures={int(i): "diverged" for i in np.flatnonzero(self._terminated[t])},
        )


def train(algorithm: Any, env: Any, folder: Path, config: Any, total_steps: int, **kwargs: Any) -> bool:
    """Train in the run directory `folder`: a new one, or with resume=True the one that is there."""
    resume = kwargs.get("resume", False)
    run = RunDirectory.open(folder) if resume else RunDirectory.create(folder, manifest={}, config={})
    try:
        options = {"seed": 0, **kwargs}
        return algorithm.train(TrainingJob(env=env, run=run, config=config, total_steps=total_steps, **options))
    finally:
        run.close()


def final_policy(algorithm: Any, folder: Path) -> TrainedPolicy:
    checkpoint = RunDirectory.open(folder).last_checkpoint()
    assert checkpoint is not None
    return algorithm.load_policy(checkpoint)
