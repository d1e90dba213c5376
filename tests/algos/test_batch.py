"""Rollouts and batches: what is bootstrapped, summed and normalised."""

from __future__ import annotations

import numpy as np
import torch

from guard_algos.batch import make_batch
from guard_algos.config import OnPolicyConfig
from guard_algos.constraints import Constraint, reduce_costs
from guard_algos.critics import Critic
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_algos.rollout import collect
from guard_algos.workers import workers
from tests.algos.bandit import Script


def script() -> Script:
    """World 0 fails after step 1 and is cut; world 1 is truncated after steps 2 and 3."""
    rng = np.random.default_rng(0)
    terminated, truncated = np.zeros((4, 2), bool), np.zeros((4, 2), bool)
    terminated[1, 0] = truncated[2, 1] = truncated[3, 1] = True
    costs = np.abs(rng.standard_normal((4, 2, 3)))
    return Script(rng.standard_normal((4, 2)), costs, terminated, truncated, np.zeros((4, 2)), ("a", "b", "c"))


def test_values_bootstrap_at_truncation_and_cut_but_not_at_termination() -> None:
    env, generator = script(), torch.Generator().manual_seed(0)
    policy = GaussianPolicy(Mlp((1, 4, 1)))
    theta = policy.init(generator, -0.5)
    act = lambda observation, noise: policy.act(theta, observation, noise)  # noqa: E731
    rollout = collect(env, act, episode=5, num_steps=4, generator=generator)  # type: ignore[arg-type]
    assert env.starts == [5]
    np.testing.assert_array_equal(np.stack(env.actions).astype(np.float32), rollout.action.numpy())
    constraints = (Constraint(name="ab", limit=0.0, columns=(0, 1)), Constraint(name="c", limit=0.0, columns=(2,)))
    critics = [Critic(Mlp((1, 4, 1)), generator, 1e-3) for _ in range(3)]
    config = OnPolicyConfig(gamma=0.9, gae_lambda=0.8)
    with workers(1) as pool:
        batch = make_batch(rollout, policy, theta, critics, constraints, config, pool)

    def value(k: int, x: float) -> float:
        with workers(1) as pool:
            return float(critics[k].predict(torch.tensor([[x]]), pool)[0])

    signal = np.concatenate([env._reward[..., None], reduce_costs(env._costs, constraints)], axis=-1)
    np.testing.assert_allclose(signal[..., 1], env._costs[..., 0] + env._costs[..., 1])
    # Observation before step t: -1 after an end, else t + world / 10. Bootstrap values of the last row and the ends:
    before = [[0.0, 0.0], [1.0, 1.1], [-1.0, 2.1], [3.0, -1.0]]
    after = {(3, 0): 4.0, (2, 1): 3.1, (3, 1): 4.1}
    targets, advantages = np.zeros((4, 2, 3)), np.zeros((4, 2, 3))
    for n in range(2):
        for k in range(3):
            goal = advantage = 0.0
            for t in reversed(range(4)):
                if (t, n) == (1, 0):
                    goal, advantage, following = 0.0, 0.0, 0.0
                elif (t, n) in after:
                    goal, advantage, following = value(k, after[t, n]), 0.0, value(k, after[t, n])
                else:
                    following = value(k, before[t + 1][n])
                goal = targets[t, n, k] = signal[t, n, k] + 0.9 * goal
                delta = signal[t, n, k] + 0.9 * following - value(k, before[t][n])
                advantage = advantages[t, n, k] = delta + 0.9 * 0.8 * advantage
    flat = advantages.reshape(8, 3) - advantages.reshape(8, 3).mean(axis=0)
    np.testing.assert_allclose(batch.targets.numpy(), targets.reshape(8, 3), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(batch.reward_advantage.numpy(), flat[:, 0] / flat[:, 0].std(), rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(batch.cost_advantages.numpy(), flat[:, 1:], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(batch.episodes.length, [2, 3, 1])


def test_a_constant_advantage_stays_zero() -> None:
    T, N = 3, 2
    ended = np.eye(T)[:, [-1] * N]
    env = Script(np.zeros((T, N)), np.zeros((T, N, 1)), ended, ended, np.zeros((T, N)), ("a",))
    generator = torch.Generator().manual_seed(0)
    policy = GaussianPolicy(Mlp((1, 4, 1)))
    theta, critic = policy.init(generator, -0.5), Critic(Mlp((1, 4, 1)), generator, 1e-3)
    critic.tensors()["parameters"].zero_()
    act = lambda observation, noise: policy.act(theta, observation, noise)  # noqa: E731
    rollout = collect(env, act, episode=0, num_steps=T, generator=generator)  # type: ignore[arg-type]
    with workers(1) as pool:
        batch = make_batch(rollout, policy, theta, [critic], (), OnPolicyConfig(), pool)
    assert not batch.reward_advantage.any()
    assert not len(rollout.last)
