"""IPO's barriers: their value and gradient, both phases, and the central path that theory predicts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.optimize import brentq

from guard_algos import trpo, trpo_ipo
from guard_algos.batch import Batch, margins
from guard_algos.trpo_ipo import TrpoIpoConfig, barred
from guard_algos.workers import workers
from guard_api.errors import SpecError
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Bandit, final_policy, train
from tests.algos.batches import constraints, permuted, sample
from tests.algos.servo import Servo, optimum
from tests.algos.test_known_optimum import LENGTH, LIMIT, SHARED, WORLDS

INSIDE, MIXED, OUTSIDE = (9.0, 5.0), (7.0, 5.0), (7.0, 3.0)
T = 20.0


def moved(batch: Batch, size: float = 0.1) -> torch.Tensor:
    """Log-probabilities (M,) of a policy near the one that acted, in double precision."""
    noise = torch.randn(len(batch.log_prob), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return batch.log_prob.double() + size * noise


def slack_of(batch: Batch, limits: tuple[float, ...]) -> np.ndarray:
    return -margins(batch.episodes, constraints(limits))


def test_slack_is_limit_minus_episode_cost_per_step() -> None:
    batch = sample(INSIDE)[2]
    cost = batch.rollout.costs.sum(axis=0).mean(axis=0)
    np.testing.assert_allclose(20 * slack_of(batch, INSIDE), np.array(INSIDE) - cost)
    assert (slack_of(batch, INSIDE) > 0).all()
    assert (slack_of(batch, OUTSIDE) < 0).all()


@pytest.mark.parametrize("limits", [INSIDE, MIXED, OUTSIDE])
def test_value_is_its_definition(limits: tuple[float, ...]) -> None:
    batch = sample(limits)[2]
    slack, log_prob = slack_of(batch, limits), moved(batch)
    ratio = torch.exp(log_prob - batch.log_prob).numpy()
    change = (ratio[:, None] * batch.cost_advantages.numpy()).mean(axis=0)
    inside = slack > 0
    if inside.all():
        gain, unit = (ratio * batch.reward_advantage.numpy()).mean(), 20 * batch.reward_advantage_std
    else:
        gain, unit = -change[~inside].sum(), 20.0
    expected = gain + np.log((slack - change)[inside]).sum() / (T * unit)
    assert float(barred(batch, slack, T)(log_prob)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("limits", [INSIDE, MIXED, OUTSIDE])
def test_gradient_equals_finite_differences(limits: tuple[float, ...]) -> None:
    policy, theta, batch = sample(limits)
    objective = barred(batch, slack_of(batch, limits), T)
    action, observation = batch.action.double(), batch.observation.double()

    def value(parameters: torch.Tensor) -> torch.Tensor:
        mean = policy.mean(parameters, observation)
        return objective(policy.log_prob(policy.split(parameters)[1], mean, action))

    at = theta.double() + 0.01  # away from the old policy, where every ratio is one
    leaf = at.clone().requires_grad_()
    with workers(1):
        gradient = torch.autograd.grad(value(leaf), leaf)[0]
        numeric = [(value(at + 1e-5 * unit) - value(at - 1e-5 * unit)) / 2e-5 for unit in torch.eye(len(at)).double()]
    torch.testing.assert_close(gradient, torch.stack(numeric), rtol=1e-5, atol=1e-8)
    assert gradient.norm() > 1e-3


def test_beyond_a_limit_that_held_there_is_no_value_and_the_line_search_does_not_go_there() -> None:
    batch = sample(INSIDE)[2]
    slack = slack_of(batch, INSIDE)
    towards = batch.cost_advantages[:, 0].double()
    objective = barred(batch, slack, T)
    beyond = batch.log_prob + 3 * towards / towards.abs().max()
    assert float((torch.exp(beyond - batch.log_prob) * towards).mean()) > slack[0]
    improvement = float(objective(beyond) - objective(batch.log_prob))
    assert not improvement >= 0  # NaN: `trust_region.improves` refuses it


def test_the_order_of_the_constraints_means_nothing() -> None:
    for limits in (INSIDE, MIXED):
        batch = sample(limits)[2]
        swapped = barred(permuted(batch, [1, 0]), slack_of(batch, limits)[::-1], T)
        log_prob = moved(batch)
        assert float(swapped(log_prob)) == pytest.approx(float(barred(batch, slack_of(batch, limits), T)(log_prob)))


SMALL: dict[str, Any] = {"steps_per_epoch": 1000, "hidden": (8,), "value_iterations": 3, "threads": 1}


def test_phase_one_lowers_the_cost_until_the_limit_holds_and_then_the_return_rises(tmp_path: Path) -> None:
    config = TrpoIpoConfig(**SMALL, gamma=0.0, cost_limit=4.0)
    train(trpo_ipo.algorithm, Bandit(50, 20, {"a": 1.0}), tmp_path, config, 30_000)
    rows = RunDirectory.open(tmp_path).rows()
    assert [row["feasible"] for row in rows] == [float(row["cost_mean"] < 4.0) for row in rows]
    first = next(i for i, row in enumerate(rows) if row["feasible"])
    assert 2 <= first < 15
    assert rows[first]["return_mean"] < rows[-1]["return_mean"] - 2
    assert all(row["kl"] <= config.target_kl for row in rows)
    assert rows[-1]["cost_mean"] < 1.05 * 4.0


def test_with_an_infinitely_steep_barrier_inside_the_limit_it_is_trpo_bit_for_bit(tmp_path: Path) -> None:
    config = TrpoIpoConfig(**SMALL, cost_limit=1e6, barrier_t=float("inf"))
    train(trpo_ipo.algorithm, Bandit(50, 20, {"a": 1.0}), tmp_path / "a", config, 6000)
    train(trpo.algorithm, Bandit(50, 20, {"a": 1.0}), tmp_path / "b", trpo.algorithm.config_type(**SMALL), 6000)
    observation = np.random.default_rng(0).standard_normal((100, 2))
    a, b = final_policy(trpo_ipo.algorithm, tmp_path / "a"), final_policy(trpo.algorithm, tmp_path / "b")
    np.testing.assert_array_equal(a.act(observation, False), b.act(observation, False))


def test_the_policy_ends_on_the_central_path(tmp_path: Path) -> None:
    """Where return + log(slack) / t is largest, the return's slope in the cost is 1 / (t slack)."""
    t = 1.0
    slack = float(brentq(lambda s: optimum(LENGTH, LIMIT - s)[1] - 1 / (t * s), 0.1, LIMIT - 0.1))  # type: ignore[arg-type]
    config = TrpoIpoConfig(**SHARED, barrier_t=t, cost_limit=LIMIT)
    train(trpo_ipo.algorithm, Servo(WORLDS, LENGTH, {"a": 1.0}), tmp_path, config, 40 * LENGTH * WORLDS)
    rows = RunDirectory.open(tmp_path).rows()[-10:]
    assert slack > 0.15 * LIMIT
    assert LIMIT - np.mean([row["cost_mean"] for row in rows]) == pytest.approx(slack, rel=0.25)


@pytest.mark.parametrize("limits", [{}, {"cost_limits": {"a": 1.0, "b": 0.0}}])
def test_a_limit_of_zero_is_refused(tmp_path: Path, limits: dict[str, Any]) -> None:
    with pytest.raises(SpecError, match=r"= 0\.0: no cost can be below it.*set a limit above 0"):
        train(trpo_ipo.algorithm, Bandit(5, 20, {"a": 1.0, "b": 1.0}), tmp_path, TrpoIpoConfig(**limits), 100)


@pytest.mark.parametrize("t", [0.0, -1.0, float("nan")])
def test_a_barrier_that_means_nothing_is_refused(t: float) -> None:
    with pytest.raises(SpecError, match="barrier_t"):
        TrpoIpoConfig(barrier_t=t)
