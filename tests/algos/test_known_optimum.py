"""Every algorithm with a limit on an episode's cost finds the constrained optimum of a linear-quadratic problem."""

from __future__ import annotations

import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from guard_algos.config import CostLimits
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import train
from tests.algos.servo import Servo, optimum

LENGTH, WORLDS = 20, 200
LIMIT = 0.36 * LENGTH
"""The best free policy costs 2.7 times as much, and the initial one's noise alone 1.1 times."""
SHARED: dict[str, Any] = {
    "steps_per_epoch": LENGTH * WORLDS,
    "hidden": (8,),
    "gamma": 0.9,
    "gae_lambda": 0.9,
    "value_iterations": 10,
    "value_learning_rate": 0.02,
    "threads": 1,
}
CASES: dict[str, tuple[str, dict[str, Any], int]] = {  # algorithm, its options, epochs
    "cpo": ("cpo", {}, 40),
    "pcpo": ("pcpo", {}, 40),
    "pcpo-l2": ("pcpo", {"projection": "l2"}, 60),
    "trpo-ipo": ("trpo-ipo", {"barrier_t": 5.0}, 50),
    "trpo-lagrangian": ("trpo-lagrangian", {"multiplier_rate": 0.1, "gae_lambda": 0.3}, 100),
    "trpo-fac": ("trpo-fac", {"multiplier_learning_rate": 0.012, "gae_lambda": 0.3}, 100),
}


def registered() -> dict[str, Any]:
    """Return the project's own algorithms by name, whether or not their entry points are installed yet."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    entries = project["project"]["entry-points"]["guard.algorithms"]
    return {name: import_module(entry.split(":")[0]).algorithm for name, entry in entries.items()}


def test_every_algorithm_with_a_cost_limit_has_a_case() -> None:
    limited = {name for name, algorithm in registered().items() if issubclass(algorithm.config_type, CostLimits)}
    assert limited == {name for name, _, _ in CASES.values()}
    assert all(name == algorithm.name for name, algorithm in registered().items())


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.slow if c == "pcpo-l2" else ()) for c in CASES])
def test_the_limit_is_reached_and_the_return_is_within_five_percent_of_the_optimum(tmp_path: Path, case: str) -> None:
    name, options, epochs = CASES[case]
    algorithm = registered()[name]
    config = algorithm.config_type(**SHARED | options, cost_limit=LIMIT)
    train(algorithm, Servo(WORLDS, LENGTH, {"a": 1.0}), tmp_path, config, epochs * LENGTH * WORLDS)
    rows, (best, multiplier) = RunDirectory.open(tmp_path).rows(), optimum(LENGTH, LIMIT)
    dual = "multiplier_cost" in rows[0]
    late = rows[-40:] if dual else rows[-10:]  # a method with multipliers swings about the limit
    cost, value = (float(np.mean([row[key] for row in late])) for key in ("cost_mean", "return_mean"))
    assert rows[0]["cost_mean"] > LIMIT
    assert 0.9 * LIMIT < cost < 1.05 * LIMIT
    assert value == pytest.approx(best, rel=0.05)
    if dual:
        found = np.mean([row["multiplier_cost"] * row["reward_advantage_std"] for row in late])
        assert multiplier / 2 < found < multiplier * 2  # `test_learning` measures it on a problem where it settles


def test_the_optimum_of_the_problem_is_what_playing_it_gives() -> None:
    best, multiplier = optimum(LENGTH, LIMIT)
    assert optimum(LENGTH, LIMIT + 0.01)[0] - best == pytest.approx(0.01 * multiplier, rel=0.01)
    env = Servo(5000, LENGTH, {"a": 1.0})
    env.reset()
    steps = [env.step(np.full((env.num_worlds, 1), 0.6)) for _ in range(LENGTH)]  # the cost of every step is 0.36
    assert sum(step.costs.mean() for step in steps) == pytest.approx(LIMIT)
    played = sum(step.reward.mean() for step in steps)
    assert 0.99 * best < played < best + 0.1
