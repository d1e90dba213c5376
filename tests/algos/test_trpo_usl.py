"""TRPO-USL: its correction against brute force and automatic differentiation, its targets, and batches of one kind."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
import pytest
import torch

from guard_algos import trpo_usl
from guard_algos.batch import make_batch
from guard_algos.config import OnPolicyConfig
from guard_algos.critics import Critic
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_algos.on_policy import Problem
from guard_algos.rollout import collect
from guard_algos.trpo_usl import TrpoUsl, TrpoUslConfig, descend, hinge_gradient
from guard_algos.workers import workers
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Script, train
from tests.algos.test_batch import script


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small tensors are not worth sharing, and a training does not share them either."""
    with workers(1):
        yield


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def problem(observation_size: int, action_size: int, names: tuple[str, ...]) -> Problem:
    return Problem(
        observation_size=observation_size,
        action_size=action_size,
        cost_names=names,
        constraints=(),
        total_steps=100,
        generator=generator(),
    )


def layer(names: tuple[str, ...] = ("a",), action_size: int = 2, **options) -> TrpoUsl:
    """A layer that works from the start, with random critics steep enough to be above and below their thresholds."""
    config = TrpoUslConfig(hidden=(8,), warmup_ratio=0.0, **options)
    method = TrpoUsl(config, problem(3, action_size, names))
    for name, tensor in method.tensors().items():
        if name.endswith("parameters"):
            tensor.mul_(3.0)
    return method


def value(method: TrpoUsl, observation: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    with workers(1) as pool:
        return method._predict(torch.cat([observation, action], dim=-1), pool)


def test_hinge_gradient_equals_automatic_differentiation() -> None:
    method = layer(("a", "b"), thresholds={"a": 0.1, "b": 0.2})
    observation = torch.randn(50, 3, generator=generator())
    action = torch.rand(50, 2, generator=generator()).mul_(2).sub_(1).requires_grad_()
    parameters = [critic.tensors()["parameters"] for critic in method._critics]
    above, gradient = hinge_gradient(method._network, parameters, method._limits, observation, action.detach())
    pairs = torch.cat([observation, action], dim=-1)
    q = torch.cat([method._network.forward(theta, pairs) for theta in parameters], dim=-1)
    hinge = (q - torch.tensor([0.1, 0.2])).clamp(min=0.0)
    torch.testing.assert_close(gradient, torch.autograd.grad(hinge.sum(), action)[0])
    np.testing.assert_array_equal(above[:, 0], (hinge > 0).any(-1))
    assert 0 < int((hinge > 0).all(-1).sum()) < int((hinge > 0).any(-1).sum()) < 50


def test_one_step_lowers_the_critic_by_eta_in_the_largest_component_also_at_the_bounds() -> None:
    action = torch.tensor([[0.5, 0.0], [1.0, 0.0], [-1.0, 0.98], [-1.0, 1.0], [0.2, 0.2]])
    gradient = torch.tensor([[2.0, -1.0], [-4.0, 1.0], [3.0, -0.5], [3.0, -0.5], [0.0, 0.0]])
    # Free; held in its largest component, so that the other goes on by eta; clipped on its way; at a minimum; flat.
    expected = torch.tensor([[0.4, 0.05], [1.0, -0.1], [-1.0, 1.0], [-1.0, 1.0], [0.2, 0.2]])
    torch.testing.assert_close(descend(action, gradient, 0.1), expected)


def test_a_correction_follows_the_gradient_until_the_threshold_and_then_stops() -> None:
    method = layer(threshold=0.3, correction_rate=0.01, correction_iterations=400)
    observation = torch.randn(300, 3, generator=generator())
    proposed = 2 * torch.randn(300, 2, generator=generator())
    executed = method.correct(observation, None, proposed)
    inside = proposed.clamp(-1, 1)
    start, end = value(method, observation, inside)[:, 0], value(method, observation, executed.clamp(-1, 1))[:, 0]
    safe = start <= 0.3
    assert 50 < int(safe.sum()) < 250
    torch.testing.assert_close(executed[safe], proposed[safe])  # and not even clipped
    corrected = ~safe
    assert executed[corrected].abs().max() <= 1
    assert (end[corrected] < start[corrected] + 1e-6).all()
    met = corrected & (end <= 0.3)
    assert (end[met] > 0.3 - 0.1).all()  # one step of the steepest critic beyond the threshold at most
    # Where it did not meet the threshold, it stands at a local minimum of the box: brute force finds none nearby.
    unmet = torch.nonzero(corrected & (end > 0.3))[:, 0]
    for i in unmet[:20].tolist():
        nearby = (executed[i] + 0.1 * (2 * torch.rand(500, 2, generator=generator()) - 1)).clamp(-1, 1)
        assert value(method, observation[i].expand(500, 3), nearby).min() >= end[i] - 0.05


def test_a_convex_critic_is_brought_to_the_threshold_wherever_the_box_has_an_action_that_meets_it() -> None:
    # Q(s, a) = w . a + b by one linear layer: the least value over the box is known.
    rng = np.random.default_rng(0)
    network = Mlp((3 + 4, 1))
    observation = torch.zeros(50, 3)
    limit = torch.tensor([0.2])
    counts = {"met": 0, "impossible": 0}
    for shift in (0.0, 0.0, 0.0, 5.0, 5.0):
        theta = torch.from_numpy(rng.standard_normal(network.num_parameters)).float()
        theta[7] += shift
        weight, bias = theta[3:7], theta[7]
        action = torch.from_numpy(rng.uniform(-1.5, 1.5, (50, 4))).float().clamp(-1, 1)
        for _ in range(200):
            above, gradient = hinge_gradient(network, [theta], limit, observation, action)
            action = torch.where(above, descend(action, gradient, 0.05), action)
        end = action @ weight + bias
        least = float(bias - weight.abs().sum())
        if least < 0.2:
            counts["met"] += 1
            assert (end <= 0.2 + 1e-6).all()
        else:
            counts["impossible"] += 1
            torch.testing.assert_close(end, torch.full((50,), least))
    assert min(counts.values()) > 0


def test_sampled_actions_outside_the_box_are_corrected_like_those_at_its_bounds() -> None:
    method = layer(threshold=0.0)
    observation = torch.randn(200, 3, generator=generator())
    outside = 3 * torch.randn(200, 2, generator=generator())
    executed = method.correct(observation, None, outside)
    at_the_bounds = method.correct(observation, None, outside.clamp(-1, 1))
    torch.testing.assert_close(executed.clamp(-1, 1), at_the_bounds)
    left = (outside.abs() > 1).any(-1)
    assert (executed[left] != outside[left]).any(-1).sum() > 20


def test_targets_are_lambda_returns_that_bootstrap_at_truncation_and_cut_but_not_at_termination() -> None:
    env = script()
    policy = GaussianPolicy(Mlp((1, 4, 1)))
    theta = policy.init(generator(), -0.5)
    config = TrpoUslConfig(hidden=(4,), warmup_ratio=0.0, gamma=0.9, gae_lambda=0.8, thresholds={"b": 0.1})
    method = TrpoUsl(config, problem(1, 1, ("a", "b", "c")))
    act = lambda observation, noise: policy.act(theta, observation, noise)  # noqa: E731
    rollout = collect(env, act, episode=0, num_steps=4, generator=generator(), correct=method.correct)  # type: ignore[arg-type]
    with workers(1) as pool:
        critic = Critic(Mlp((1, 4, 1)), generator(), 1e-3)
        batch = make_batch(rollout, policy, theta, [critic], (), OnPolicyConfig(), pool)
        found = targets(method, policy, theta, batch, pool)

    def q(observation: torch.Tensor, action: torch.Tensor) -> float:
        return float(value(method, observation[None], action.clamp(-1, 1)[None])[0, 0])

    last = {(3, 0): 4.0, (2, 1): 3.1, (3, 1): 4.1}
    expected = np.zeros((4, 2))
    for n in range(2):
        goal = 0.0
        for t in reversed(range(4)):
            if (t, n) in last:
                observation = torch.tensor([last[t, n]])
                mean = policy.mean(theta, observation[None])
                following = goal = q(observation, method.correct(observation[None], None, mean)[0])
            elif (t, n) == (1, 0):
                following = goal = 0.0
            else:
                following = q(rollout.observation[t + 1, n], rollout.executed[t + 1, n])
            # G_t = c + gamma ((1 - lambda) Q(s', a') + lambda G_{t+1})
            goal = expected[t, n] = env._costs[t, n, 1] + 0.9 * (0.2 * following + 0.8 * goal)
    np.testing.assert_allclose(found[:, 0].reshape(4, 2), expected, rtol=1e-5)


def targets(method: TrpoUsl, policy, theta, batch, pool: Executor) -> np.ndarray:
    pairs = torch.cat([batch.observation, batch.rollout.executed.flatten(0, 1).clamp(-1, 1)], dim=-1)
    return method._targets(policy, theta, batch, method._predict(pairs, pool), pool).numpy()


@pytest.mark.parametrize("cost", [0.0, 0.7])
def test_batches_without_any_and_with_nothing_but_costs_train_to_finite_numbers(tmp_path: Path, cost: float) -> None:
    T, N = 10, 4
    ended = np.eye(T)[:, [-1] * N]
    reward = np.random.default_rng(0).standard_normal((T, N))
    env = Script(reward, np.full((T, N, 1), cost), np.zeros((T, N)), ended, np.zeros((T, N)), ("a",))
    options = {"steps_per_epoch": T * N, "hidden": (4,), "value_iterations": 60, "value_learning_rate": 0.02}
    config = TrpoUslConfig(**options, warmup_ratio=0.25, threshold=0.05, gamma=0.5)
    train(trpo_usl.algorithm, env, tmp_path, config, 6 * T * N)
    rows = RunDirectory.open(tmp_path).rows()
    assert np.isfinite([list(row.values()) for row in rows]).all()
    if cost:  # no action helps, and the log says so
        assert rows[-1]["unmet_rate"] > 0.9
    else:  # the threshold can be met: nothing is left to correct once the critic knows
        assert rows[-1]["unmet_rate"] == 0 and rows[-1]["corrected_rate"] < 0.1
