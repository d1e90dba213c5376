"""Learning on a problem of single steps: what costs change, and what they leave as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from guard_algos import cpo, trpo, trpo_fac, trpo_lagrangian
from guard_algos.on_policy import OnPolicyAlgorithm
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Bandit, final_policy, train

LENGTH = 20
FAST = {
    "steps_per_epoch": 2000,
    "hidden": (8,),
    "gamma": 0.0,
    "value_iterations": 5,
    "value_learning_rate": 0.02,
    "threads": 1,
}


def per_step(policy, scale: float = 1.0) -> tuple[float, float]:
    """Expected reward and cost of one step under the stochastic policy, from many samples without the noise."""
    observation = 0.1 * np.random.default_rng(1).standard_normal((20_000, 2))
    action = policy.act(observation, deterministic=False)[:, 0]
    return float(np.mean(1 - (action - 1) ** 2)), float(scale * np.mean(action**2))


def test_trpo_ignores_costs_and_finds_the_unconstrained_optimum(tmp_path: Path) -> None:
    config = trpo.algorithm.config_type(**FAST)
    train(trpo.algorithm, Bandit(50, LENGTH, {"a": 1.0}), tmp_path, config, 80_000)
    reward, cost = per_step(final_policy(trpo.algorithm, tmp_path))
    assert reward > 0.95
    assert cost > 0.8


def test_cpo_keeps_two_named_limits_of_which_one_binds(tmp_path: Path) -> None:
    config = cpo.CpoConfig(**FAST, cost_limits={"b": 1.0 * LENGTH, "a": 0.25 * LENGTH})
    train(cpo.algorithm, Bandit(50, LENGTH, {"a": 1.0, "b": 0.25}), tmp_path, config, 160_000)
    reward, cost = per_step(final_policy(cpo.algorithm, tmp_path))
    assert cost == pytest.approx(0.25, rel=0.1)
    assert reward == pytest.approx(0.75, rel=0.05)


@pytest.mark.parametrize(
    ("algorithm", "rate"),
    [
        (trpo_lagrangian.algorithm, {"multiplier_rate": 0.05}),
        pytest.param(trpo_fac.algorithm, {"multiplier_learning_rate": 0.01}, marks=pytest.mark.slow),
    ],
    ids=["trpo-lagrangian", "trpo-fac"],
)
def test_multipliers_reach_the_limit_the_optimal_return_and_the_dual_value(
    tmp_path: Path, algorithm: OnPolicyAlgorithm, rate: dict[str, float]
) -> None:
    options = FAST | {"steps_per_epoch": 8000, "target_kl": 0.005}  # a small step: the policy ripples less about it
    config = algorithm.config_type(**options, **rate, cost_limit=0.25 * LENGTH)
    train(algorithm, Bandit(400, LENGTH, {"a": 1.0}), tmp_path, config, 120 * 8000)
    reward, cost = per_step(final_policy(algorithm, tmp_path))
    rows = RunDirectory.open(tmp_path).rows()[-50:]
    multiplier = np.mean([row["multiplier_cost"] * row["reward_advantage_std"] for row in rows])
    assert cost == pytest.approx(0.25, rel=0.1)
    assert reward == pytest.approx(0.75, rel=0.05)
    assert multiplier == pytest.approx(1.0, rel=0.25)


def test_trpo_lagrangian_without_cost_is_trpo_bit_for_bit(tmp_path: Path) -> None:
    free = {"a": 0.0}
    plain, lagrangian = trpo.algorithm, trpo_lagrangian.algorithm
    train(plain, Bandit(50, LENGTH, free), tmp_path / "a", plain.config_type(**FAST), 10_000)
    train(lagrangian, Bandit(50, LENGTH, free), tmp_path / "b", lagrangian.config_type(**FAST), 10_000)
    observation = np.random.default_rng(0).standard_normal((100, 2))
    a, b = final_policy(plain, tmp_path / "a"), final_policy(lagrangian, tmp_path / "b")
    np.testing.assert_array_equal(a.act(observation), b.act(observation))
    np.testing.assert_array_equal(a.act(observation, False), b.act(observation, False))
