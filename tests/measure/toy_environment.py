"""A car on a line, in "engines" that differ by how far one push moves it: small enough to check by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from guard_api.env import Step

GAINS = {"exact": 0.10, "twin": 0.10, "strong": 0.13}
"""Engine -> distance per unit of action [m]."""

LENGTH = 20


class ToyEnvironment:
    """The part of `Environment` that a rollout uses. Reward: progress to the right; cost: metres beyond the line x = 1.

    diverge: (world, episode, step) whose physics fails. An episode's start comes from (seed, world, episode) alone.
    """

    cost_names = ("line", "spare")
    action_size = 1
    episode_length = LENGTH

    def __init__(self, backend: str = "exact", num_worlds: int = 4, seed: int = 0, diverge: set | None = None):
        self.gain, self.num_worlds, self.seed = GAINS[backend], num_worlds, seed
        self.diverge = diverge or set()
        self.world = SimpleNamespace(approximations=(f"{backend} is a toy",))
        self.closed = False
        self.episode = np.zeros(num_worlds, dtype=int)
        self.time = np.zeros(num_worlds, dtype=int)
        self.x = np.zeros(num_worlds)

    def reset(self, episode: int = 0, seed: int | None = None):
        self.seed = self.seed if seed is None else seed
        self.episode[:] = episode
        self._begin(np.ones(self.num_worlds, dtype=bool))
        return self.x[:, None].copy()

    def step(self, action):
        assert np.isfinite(action).all()
        moved = self.gain * np.clip(action[:, 0], -1, 1)
        self.x += moved
        self.time += 1
        failures = {
            i: "diverged"
            for i in range(self.num_worlds)
            if (i, int(self.episode[i]), int(self.time[i])) in self.diverge
        }
        terminated = np.isin(np.arange(self.num_worlds), list(failures))
        truncated = (self.time >= LENGTH) & ~terminated
        costs = np.stack([np.maximum(self.x - 1.0, 0.0), np.zeros(self.num_worlds)], axis=1)
        success = (self.x > 0.5) & ~terminated
        final = self.x[:, None].copy()
        ended = terminated | truncated
        self.episode[ended] += 1
        self._begin(ended)
        return Step(
            observation=self.x[:, None].copy(),
            reward=np.where(terminated, -10.0, moved),
            costs=np.where(terminated[:, None], 1.0, costs),
            terminated=terminated,
            truncated=truncated,
            final_observation=final,
            success=success,
            failures=failures,
        )

    def close(self):
        self.closed = True

    def _begin(self, mask):
        self.time[mask] = 0
        for i in np.flatnonzero(mask):
            stream = np.random.SeedSequence(self.seed, spawn_key=(int(i), int(self.episode[i])))
            self.x[i] = np.random.default_rng(stream).uniform(-0.5, 0.5)


class Push:
    """A policy that always pushes with one strength."""

    def __init__(self, strength: float):
        self.strength = strength

    def act(self, observation, deterministic=True, costs=None):
        return np.full((len(observation), 1), self.strength)
