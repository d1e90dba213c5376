"""A batch to update from, without a training around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from guard_algos.batch import Batch, make_batch
from guard_algos.config import OnPolicyConfig
from guard_algos.constraints import Constraint
from guard_algos.critics import Critic
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_algos.rollout import collect
from guard_algos.workers import workers
from tests.algos.bandit import Bandit


def sample(limits: Sequence[float] = (7.0, 3.0), worlds: int = 20) -> tuple[GaussianPolicy, Tensor, Batch]:
    """Return a policy, its parameters and a batch of 20 steps of each world, of constraints a, b, c, ... on a^2."""
    names = "abcdef"[: len(limits)]
    env = Bandit(worlds, 20, {name: 1.0 / (k + 1) for k, name in enumerate(names)})
    generator = torch.Generator().manual_seed(0)
    policy = GaussianPolicy(Mlp((2, 4, 1)))
    theta = policy.init(generator, -0.5)
    critics = [Critic(Mlp((2, 4, 1)), generator, 1e-3) for _ in range(1 + len(limits))]
    act = lambda observation, noise: policy.act(theta, observation, noise)  # noqa: E731
    rollout = collect(env, act, episode=0, num_steps=20, generator=generator)  # type: ignore[arg-type]
    with workers(1) as pool:
        batch = make_batch(rollout, policy, theta, critics, constraints(limits), OnPolicyConfig(), pool)
    return policy, theta, batch


def constraints(limits: Sequence[float]) -> tuple[Constraint, ...]:
    return tuple(Constraint(name="abcdef"[k], limit=limit, columns=(k,)) for k, limit in enumerate(limits))


def permuted(batch: Batch, order: Sequence[int]) -> Batch:
    """Return the batch as it would be had its constraints been listed in another order."""
    index, episodes = list(order), batch.episodes
    return replace(
        batch,
        cost_advantages=batch.cost_advantages[:, index],
        targets=batch.targets[:, [0, *(1 + k for k in index)]],
        episodes=replace(episodes, constrained_costs=episodes.constrained_costs[:, index]),
    )
