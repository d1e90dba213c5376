"""FAC's state-wise multipliers: their gradient, where they rise and fall, and what they are without cost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import softplus

from guard_algos import trpo
from guard_algos.networks import ROWS, Mlp
from guard_algos.on_policy import OnPolicyAlgorithm, Problem
from guard_algos.statewise_multiplier import StatewiseMultipliers
from guard_algos.trpo_fac import TrpoFac, TrpoFacConfig, excess
from guard_algos.workers import workers
from guard_api.errors import SpecError
from tests.algos.bandit import Bandit, final_policy, train
from tests.algos.batches import constraints, permuted, sample

LIMITS = (7.0, 3.0, 1.0)


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_gradient_equals_automatic_differentiation() -> None:
    network = Mlp((2, 5, 1))
    multipliers = StatewiseMultipliers(network, 2, 1e-3, generator())
    parameters = multipliers.tensors()["parameters"]
    parameters.add_(0.3 * torch.randn(len(parameters), generator=generator()))  # the two are no longer the same
    x = torch.randn(ROWS + 7, 2, generator=generator())
    e = torch.randn(ROWS + 7, 2, generator=generator())
    leaf = parameters.clone().requires_grad_()
    values = [softplus(network.forward(part, x)) for part in leaf.split(network.num_parameters)]
    expected = torch.autograd.grad((torch.cat(values, dim=1) * e).sum(dim=1).mean(), leaf)[0]
    with workers(2) as pool:
        torch.testing.assert_close(multipliers.predict(x, pool), torch.cat([v.detach() for v in values], dim=1))
        torch.testing.assert_close(multipliers.gradient(x, e, pool), expected, rtol=1e-4, atol=1e-7)


def test_multipliers_rise_where_the_limit_is_exceeded_fall_where_it_is_not_and_stay_positive() -> None:
    multipliers = StatewiseMultipliers(Mlp((1, 16, 1)), 1, 0.02, generator())
    x = torch.linspace(-2, 2, 200)[:, None]
    with workers(1) as pool:
        start = multipliers.predict(x, pool)
        for _ in range(150):
            multipliers.ascend(x, torch.sign(x), pool)  # exceeded on the right half of the states
        split = multipliers.predict(x, pool)
        assert (split[x > 0.5] > start[x > 0.5] + 1).all()
        assert (split[x < -0.5] < start[x < -0.5] / 2).all()
        for _ in range(300):
            multipliers.ascend(x, -torch.ones_like(x), pool)
        fallen = multipliers.predict(x, pool)
        assert (fallen < 0.1).all() and (fallen > 0).all()
        for _ in range(300):
            multipliers.ascend(x, torch.ones_like(x), pool)
        assert (multipliers.predict(x, pool) > 1).all()  # and they can rise again


def test_a_policy_that_spends_the_limit_evenly_is_on_it_in_every_state() -> None:
    batch, gamma = sample(LIMITS)[2], 0.9
    rate = torch.tensor(LIMITS) / 20  # cost per step of an episode of 20
    cost_to_go = rate / (1 - gamma)
    targets = torch.cat([torch.zeros(400, 1), cost_to_go.expand(400, 3) * torch.tensor([1.0, 1.5, 0.5])], dim=1)
    found = excess(replace(batch, targets=targets), constraints(LIMITS), gamma)
    torch.testing.assert_close(found, (cost_to_go * torch.tensor([0.0, 0.5, -0.5])).expand(400, 3), atol=1e-5, rtol=0)


def improve(order: list[int]) -> tuple[torch.Tensor, dict[str, float], dict[str, torch.Tensor]]:
    """One update of the same batch with its constraints in another order: parameters, row, state."""
    policy, theta, batch = sample(LIMITS)
    problem = Problem(
        observation_size=2,
        action_size=1,
        cost_names=("a", "b", "c"),
        constraints=tuple(constraints(LIMITS)[k] for k in order),
        generator=generator(),
        total_steps=400,
    )
    method = TrpoFac(TrpoFacConfig(hidden=(4,), multiplier_learning_rate=0.1), problem)
    with workers(1) as pool, torch.no_grad():
        row = method.improve(policy, theta, permuted(batch, order), pool)
    return theta, row, method.tensors()


def test_permuted_constraints_give_permuted_multipliers_and_the_same_policy() -> None:
    theta, row, state = improve([0, 1, 2])
    other_theta, other_row, other_state = improve([2, 0, 1])
    torch.testing.assert_close(theta, other_theta, rtol=1e-4, atol=1e-5)
    for name in ("multiplier_a", "multiplier_b", "multiplier_c", "multiplier_a_max"):
        assert row[name] == other_row[name]
    networks = state["multiplier.parameters"].view(3, -1)
    torch.testing.assert_close(networks[[2, 0, 1]], other_state["multiplier.parameters"].view(3, -1), rtol=0, atol=0)
    assert not torch.equal(networks[0], networks[2])


def test_logged_multipliers_are_those_after_the_update() -> None:
    _, row, state = improve([0, 1, 2])
    batch, network = sample(LIMITS)[2], Mlp((2, 4, 1))
    for name, parameters in zip("abc", state["multiplier.parameters"].split(network.num_parameters), strict=True):
        values = softplus(network.forward(parameters, batch.observation))
        assert row[f"multiplier_{name}"] == pytest.approx(float(values.mean()), rel=1e-6)
        assert row[f"multiplier_{name}_max"] == pytest.approx(float(values.max()), rel=1e-6)


class Unpenalised(TrpoFac):
    """FAC whose multipliers are zero in every state, and stay so."""

    def __init__(self, config: TrpoFacConfig, problem: Problem) -> None:
        super().__init__(config, problem)
        parameters = self.tensors()["multiplier.parameters"]
        parameters.zero_()
        parameters[-1] = -1e3  # softplus and its slope round to 0


def test_with_multipliers_of_zero_it_is_trpo_bit_for_bit(tmp_path: Path) -> None:
    small: dict[str, Any] = {"steps_per_epoch": 1000, "hidden": (8,), "value_iterations": 3, "threads": 1}
    free = OnPolicyAlgorithm(name="trpo-fac", config_type=TrpoFacConfig, method=Unpenalised)
    train(free, Bandit(50, 20, {"a": 1.0}), tmp_path / "a", TrpoFacConfig(**small), 6000)
    train(trpo.algorithm, Bandit(50, 20, {"a": 1.0}), tmp_path / "b", trpo.algorithm.config_type(**small), 6000)
    observation = np.random.default_rng(0).standard_normal((100, 2))
    a, b = final_policy(free, tmp_path / "a"), final_policy(trpo.algorithm, tmp_path / "b")
    np.testing.assert_array_equal(a.act(observation, False), b.act(observation, False))


@pytest.mark.parametrize(("option", "value"), [("multiplier_learning_rate", -1e-4), ("gamma", 1.0)])
def test_options_that_mean_nothing_are_refused(option: str, value: float) -> None:
    with pytest.raises(SpecError, match=option):
        TrpoFacConfig(**{option: value})
