"""TRPO-USL: TRPO behind an unrolling safety layer, which moves an action down the critic of the costs to come.

    a_0 = a_pi,   a_{k+1} = a_k - (eta / Z) d/da sum_j [Q_j(s, a_k) - d_j]^+,   until every Q_j(s, a_k) <= d_j

Q_j(s, a) are the discounted costs to come of what is executed, d_j their thresholds, Z the largest component of the
gradient. Source: Zhang et al. 2022, "Evaluating Model-free Reinforcement Learning toward Safety-critical Tasks"; as
GUARD, only the layer is taken, not the penalty in that paper's policy objective, so that the layer alone is compared.

Decisions:
- A sampled action outside [-1, 1] is clipped first, as the environment would, and every step ends in the box. GUARD's
  code leaves such an action uncorrected: at its initial width one in ten for each dimension of the action.
- A component at a bound that the gradient pushes outwards does not move and does not count in Z. So the others go on by
  eta a step, and the layer stops only at a minimum of the box.
- The critic's output is linear. With GUARD's softplus it never reaches the threshold of 0, and every action is moved.
- Targets are lambda-returns of the executed actions, bootstrapped where an episode is truncated or cut, as the critics
  of the other algorithms: with one fit per epoch, the paper's one-step targets look ahead one step more per epoch.
- What is executed cannot take part in the policy's gradient, and the proposed action does: `shield` says why.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from guard_algos import gae, shield, trust_region
from guard_algos.batch import Batch
from guard_algos.constraints import reduce_costs
from guard_algos.critics import Critic
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem
from guard_algos.rollout import Correct
from guard_api.errors import SpecError


@dataclass(frozen=True, kw_only=True)
class TrpoUslConfig(shield.ShieldConfig):
    """Options of TRPO-USL; the critics of the costs are fitted with the options of the others."""

    correction_iterations: int = 20
    """Most gradient steps on one action, K."""
    correction_rate: float = 0.05
    """Largest change of an action's component in one of them, eta."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        super().__post_init__()
        for name in ("correction_iterations", "correction_rate"):
            if not getattr(self, name) > 0:
                raise SpecError(f"{name} = {getattr(self, name)}: must be positive")


class TrpoUsl(Method):
    """TRPO on the proposed actions; the layer's critics are fitted to the executed ones."""

    def __init__(self, config: TrpoUslConfig, problem: Problem) -> None:
        self._config = config
        self._signals = config.signals(problem.cost_names)
        self._limits = torch.tensor([signal.limit for signal in self._signals])
        self._warmup = shield.Warmup(config.warmup_ratio, problem.total_steps)
        self._network = Mlp((problem.observation_size + problem.action_size, *config.hidden, 1))
        self._critics = [Critic(self._network, problem.generator, config.value_learning_rate) for _ in self._signals]

    def correct(self, observation: Tensor, costs: Tensor | None, action: Tensor) -> Tensor:
        """Return `action` (N, A), moved down where a critic is above its threshold; `costs` do not matter."""
        return self._corrected(observation, action, stop_early=True) if self._warmup.over else action

    def traceable(self) -> Correct | None:
        """Return the correction as tensor operations alone; None where the layer does not work yet."""
        if not self._warmup.over:
            return None
        return lambda observation, costs, action: self._corrected(observation, action, stop_early=False)

    def tensors(self) -> dict[str, Tensor]:
        """Return the critics and the place in the warm-up."""
        parts = {f"critic.{s.name}": critic.tensors() for s, critic in zip(self._signals, self._critics, strict=True)}
        parts["warmup"] = self._warmup.tensors()
        return {f"{part}.{key}": tensor for part, tensors in parts.items() for key, tensor in tensors.items()}

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate return, then fit the critics of the costs."""
        config = self._config
        pairs = torch.cat([batch.observation, shield.clipped(batch.rollout.executed.flatten(0, 1))], dim=-1)
        value = self._predict(pairs, pool)
        targets = self._targets(policy, theta, batch, value, pool)
        row = shield.row(batch, self._warmup.over, (value > self._limits).any(-1))
        objective = trust_region.surrogate(batch.reward_advantage, batch.log_prob)
        row |= trust_region.update(policy, theta, batch, config, pool, objective=objective).row()
        for signal, critic, target in zip(self._signals, self._critics, targets.T.contiguous(), strict=True):
            before, after = critic.fit(pairs, target, config.value_iterations, config.value_batch_size, pool)
            row |= {f"shield_{signal.name}_loss_before": before, f"shield_{signal.name}_loss_after": after}
        self._warmup.advance(len(pairs))
        return row

    def _corrected(self, observation: Tensor, action: Tensor, stop_early: bool) -> Tensor:
        """Return the corrected actions; an action within the thresholds stays, whether the loop stops early or not."""
        parameters = [critic.tensors()["parameters"] for critic in self._critics]
        inside, moved = shield.clipped(action), torch.zeros_like(action[:, :1], dtype=torch.bool)
        for _ in range(self._config.correction_iterations):
            above, gradient = hinge_gradient(self._network, parameters, self._limits, observation, inside)
            if stop_early and not bool(above.any()):
                break
            moved = moved | above
            inside = descend(inside, gradient, self._config.correction_rate)
        return torch.where(moved, inside, action)

    def _predict(self, pairs: Tensor, pool: Executor) -> Tensor:
        """Return Q (M, K) of observations and actions (M, O + A)."""
        return torch.stack([critic.predict(pairs, pool) for critic in self._critics], dim=-1)

    def _targets(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, value: Tensor, pool: Executor) -> Tensor:
        """Return the lambda-returns (M, K) of the costs under the critics' `value` (M, K) of what was executed.

        After the last observation of a truncated or cut episode, the action is the executed form of the policy's mean.
        """
        rollout, config = batch.rollout, self._config
        shape = (*rollout.ended.shape, len(self._signals))
        now = value.double().numpy().reshape(shape)
        following = np.concatenate([now[1:], np.zeros_like(now[:1])])
        last = rollout.last_observation
        action = shield.clipped(self.correct(last, None, policy.mean(theta, last)))
        following.reshape(-1, shape[-1])[rollout.last] = self._predict(torch.cat([last, action], dim=-1), pool).numpy()
        following[rollout.terminated] = 0.0
        costs = reduce_costs(rollout.costs, self._signals)
        estimate = gae.advantages(costs, now, following, rollout.ended, config.gamma, config.gae_lambda)
        return torch.from_numpy((now + estimate).reshape(-1, shape[-1])).float()


def hinge_gradient(
    network: Mlp, parameters: list[Tensor], limits: Tensor, observation: Tensor, action: Tensor
) -> tuple[Tensor, Tensor]:
    """Return whether a critic is above its limit (N, 1), and d/da sum_j [Q_j(s, a) - d_j]^+ (N, A)."""
    pairs = torch.cat([observation, action], dim=-1)
    above, gradient = torch.zeros_like(action[:, :1], dtype=torch.bool), torch.zeros_like(action)
    for theta, limit in zip(parameters, limits, strict=True):
        activations = network.activations(theta, pairs)
        exceeded = activations[-1] > limit
        above = above | exceeded
        slope = network.input_gradient(theta, activations, exceeded.to(action.dtype))
        gradient = gradient + slope[:, observation.shape[-1] :]
    return above, gradient


def descend(action: Tensor, gradient: Tensor, rate: float) -> Tensor:
    """Return `action` (N, A) in the box, moved against `gradient` by `rate` in its largest component that can move."""
    blocked = ((action <= -1) & (gradient > 0)) | ((action >= 1) & (gradient < 0))
    free = torch.where(blocked, 0.0, gradient)
    largest = free.abs().amax(dim=-1, keepdim=True).clamp(min=torch.finfo(action.dtype).tiny)
    return shield.clipped(action - rate * (free / largest))


algorithm = OnPolicyAlgorithm(name="trpo-usl", config_type=TrpoUslConfig, method=TrpoUsl, corrects=True)
