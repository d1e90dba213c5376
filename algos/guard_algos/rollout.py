"""Collecting one epoch of experience: whole episodes of every world of the batched environment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos.finite import finite

if TYPE_CHECKING:
    from guard_api.env import Environment

Act: TypeAlias = Callable[[Tensor, Tensor], Tensor]
"""From observations (N, O) and standard normal noise (N, A) to proposed actions (N, A)."""

Correct: TypeAlias = Callable[[Tensor, Tensor | None, Tensor], Tensor]
"""From observations (N, O), the costs (N, C) of the step before, 0 at an episode's start, and proposed actions (N, A)
to the actions (N, A) that are executed. None stands for costs that the caller does not know."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rollout:
    """T steps of N worlds, in order.

    observation: (T, N, O) float32, before the step. action: (T, N, A) float32, as sampled. executed: (T, N, A) float32,
    as it went to the environment, which clips it: `action`, or its correction.
    reward: (T, N). costs: (T, N, C). success, terminated, ended: (T, N) bool; an episode ended by failure, or at all.
    last: (E,) flat indices t N + i of the steps whose episode goes on, but not in the next row: it was truncated or the
    rollout ended. last_observation: (E, O) float32, the true observation after those steps, for a bootstrap.
    diverged: number of worlds whose physics failed.
    """

    observation: Tensor
    action: Tensor
    executed: Tensor
    reward: NDArray[np.float64]
    costs: NDArray[np.float64]
    success: NDArray[np.bool_]
    terminated: NDArray[np.bool_]
    ended: NDArray[np.bool_]
    last: NDArray[np.intp]
    last_observation: Tensor
    diverged: int


def collect(
    env: Environment,
    act: Act,
    *,
    episode: int,
    num_steps: int,
    generator: torch.Generator,
    correct: Correct = lambda observation, costs, action: action,
) -> Rollout:
    """Start every world at index `episode` and take `num_steps` steps, going on with the next episode where one ends.

    Raises NotFiniteError for an observation, reward or cost that is not finite in single precision.
    """
    rollout = _allocate(env, num_steps)
    noise = torch.randn(rollout.action.shape, generator=generator)
    last, last_observation = [rollout.last], [np.empty((0, env.observation_size))]
    diverged = 0
    now, costs = env.reset(episode=episode), np.zeros((env.num_worlds, len(env.cost_names)))
    for t in range(num_steps):
        rollout.observation[t] = torch.from_numpy(now)
        rollout.action[t] = act(rollout.observation[t], noise[t])
        rollout.executed[t] = correct(rollout.observation[t], torch.from_numpy(costs), rollout.action[t])
        step = env.step(rollout.executed[t].double().numpy())
        now = step.observation
        rollout.reward[t], rollout.costs[t], rollout.success[t] = step.reward, step.costs, step.success
        rollout.terminated[t], rollout.ended[t] = step.terminated, step.terminated | step.truncated
        costs = np.where(rollout.ended[t][:, None], 0.0, step.costs)
        diverged += len(step.failures)
        cut = ~step.terminated if t == num_steps - 1 else step.truncated & ~step.terminated
        if cut.any():
            last.append(t * env.num_worlds + np.flatnonzero(cut))
            last_observation.append(step.final_observation[cut])
    finite(rollout.observation, "observation")
    finite(torch.from_numpy(rollout.reward), "reward")
    finite(torch.from_numpy(rollout.costs), "cost")
    return replace(
        rollout,
        last=np.concatenate(last),
        last_observation=finite(torch.from_numpy(np.concatenate(last_observation)).float(), "last observation"),
        diverged=diverged,
    )


def _allocate(env: Environment, T: int) -> Rollout:
    """Return a rollout of T steps to be filled in."""
    N = env.num_worlds
    return Rollout(
        observation=torch.empty(T, N, env.observation_size),
        action=torch.empty(T, N, env.action_size),
        executed=torch.empty(T, N, env.action_size),
        reward=np.empty((T, N)),
        costs=np.empty((T, N, len(env.cost_names))),
        success=np.empty((T, N), bool),
        terminated=np.empty((T, N), bool),
        ended=np.empty((T, N), bool),
        last=np.empty(0, np.intp),
        last_observation=torch.empty(0, env.observation_size),
        diverged=0,
    )
