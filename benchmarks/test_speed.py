"""Speed of what users wait for; `make bench` saves the figures and compares them with the last saved run."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api import plugins
from guard_api.algorithm import TrainingJob
from guard_api.env import make_environment
from guard_api.runs.directory import RunDirectory

ENV = "Goal_Point_8Hazards"
BACKENDS = [name for name, reason in plugins.available("guard.backends").items() if reason is None]


@pytest.mark.parametrize("backend", BACKENDS)
def test_environment_step(benchmark, backend: str) -> None:
    env = make_environment(ENV, backend=backend, num_worlds=64)
    action = np.random.default_rng(0).uniform(-1, 1, (64, env.action_size))
    env.reset()
    env.episode_length = 10**9  # so that no reset falls into the timing
    benchmark.extra_info["steps_per_call"] = 64
    benchmark.pedantic(env.step, args=(action,), rounds=20, iterations=10, warmup_rounds=2)
    env.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_raw_physics(benchmark, backend: str) -> None:
    env = make_environment(ENV, backend=backend, num_worlds=64)
    env.reset()
    env.step(np.zeros((64, env.action_size)))
    benchmark.extra_info["steps_per_call"] = 64
    benchmark.pedantic(env.world.step_raw, args=(env.substeps,), rounds=20, iterations=10, warmup_rounds=2)
    env.close()


def test_reset(benchmark) -> None:
    env = make_environment(ENV, backend="mujoco", num_worlds=64)
    benchmark.pedantic(env.reset, rounds=20, warmup_rounds=2)
    env.close()


@pytest.mark.parametrize("name", ["trpo", "cpo"])
def test_training_epoch(benchmark, name: str, tmp_path) -> None:
    """One epoch of the paper's size: 30 worlds x 1000 steps and the update."""
    algorithm = plugins.load("guard.algorithms", name)
    env = make_environment(ENV, backend="mujoco", num_worlds=30)
    runs = iter(range(100))

    def epoch() -> None:
        run = RunDirectory.create(tmp_path / str(next(runs)), manifest={}, config={})
        algorithm.train(TrainingJob(env=env, run=run, config=algorithm.config_type(), total_steps=30_000, seed=0))
        run.close()

    benchmark.pedantic(epoch, rounds=3, warmup_rounds=1)
    env.close()
