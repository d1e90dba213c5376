"""What an update learns from: a rollout with its advantages and value targets."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos import gae
from guard_algos.config import OnPolicyConfig
from guard_algos.constraints import Constraint, reduce_costs
from guard_algos.critics import Critic
from guard_algos.episodes import Episodes, finished
from guard_algos.gaussian import GaussianPolicy
from guard_algos.rollout import Rollout

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """One epoch's M = T N samples, time by time, float32.

    observation: (M, O). action: (M, A). mean, log_prob: (M, A), (M,) of the policy that acted.
    reward_advantage: (M,), zero mean and unit variance. cost_advantages: (M, K), zero mean, in the unit of the cost; 0
    for a cost that did not occur at all.
    targets: (M, 1 + K), discounted reward and costs to go. reward_advantage_std: before it was scaled away.
    margins: (K,), how far each constraint is exceeded (`margins`).
    """

    rollout: Rollout
    episodes: Episodes
    observation: Tensor
    action: Tensor
    mean: Tensor
    log_prob: Tensor
    reward_advantage: Tensor
    cost_advantages: Tensor
    targets: Tensor
    reward_advantage_std: float
    margins: Array


def make_batch(
    rollout: Rollout,
    policy: GaussianPolicy,
    theta: Tensor,
    critics: Sequence[Critic],
    constraints: Sequence[Constraint],
    config: OnPolicyConfig,
    pool: Executor,
) -> Batch:
    """Estimate the advantages of `rollout` under `critics`: of the reward, then of each constraint."""
    observation, action = rollout.observation.flatten(0, 1), rollout.action.flatten(0, 1)
    signal = np.concatenate([rollout.reward[..., None], reduce_costs(rollout.costs, constraints)], axis=-1)
    value, next_value = _values(rollout, critics, pool)
    estimates = gae.advantages(signal, value, next_value, rollout.ended, config.gamma, config.gae_lambda)
    targets = value + gae.advantages(signal, value, next_value, rollout.ended, config.gamma, 1.0)
    flat = estimates.reshape(-1, signal.shape[-1])
    flat -= flat.mean(axis=0)
    flat[:, ~signal.any(axis=(0, 1))] = 0.0  # of what did not occur there is nothing to learn but a critic's error
    std = float(flat[:, 0].std())
    mean = policy.means(theta, observation, pool)
    episodes = finished(rollout, constraints)
    return Batch(
        rollout=rollout,
        episodes=episodes,
        observation=observation,
        action=action,
        mean=mean,
        log_prob=policy.log_prob(policy.split(theta)[1], mean, action),
        reward_advantage=torch.from_numpy(flat[:, 0] / max(std, 1e-8)).float(),
        cost_advantages=torch.from_numpy(flat[:, 1:]).float(),
        targets=torch.from_numpy(targets.reshape(flat.shape)).float(),
        reward_advantage_std=std,
        margins=margins(episodes, constraints),
    )


def margins(episodes: Episodes, constraints: Sequence[Constraint]) -> Array:
    """Return c (K,): the excess of the mean episode cost over its limit, per step, as the surrogate costs are.

    An episode's cost is undiscounted, the surrogate's advantage is discounted: the line search checks what that omits.
    Source: Achiam et al. 2017, section 6.1, with GUARD's division by the episode's length.
    """
    limits = np.array([constraint.limit for constraint in constraints])
    return (episodes.constrained_costs.mean(axis=0) - limits) / episodes.length.mean()


def _values(rollout: Rollout, critics: Sequence[Critic], pool: Executor) -> tuple[Array, Array]:
    """Return the critics' values (T, N, 1 + K) before each step, and after it as `gae.advantages` wants them."""

    def predict(observation: Tensor) -> Array:
        return torch.stack([critic.predict(observation, pool) for critic in critics], dim=-1).double().numpy()

    value = predict(rollout.observation.flatten(0, 1)).reshape(*rollout.ended.shape, len(critics))
    next_value = np.concatenate([value[1:], np.zeros_like(value[:1])])
    next_value.reshape(-1, len(critics))[rollout.last] = predict(rollout.last_observation)
    next_value[rollout.terminated] = 0.0
    return value, next_value
