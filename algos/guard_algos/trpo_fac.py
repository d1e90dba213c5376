"""Feasible Actor-Critic on a trust region: a limit on the cost to come from every state, with a multiplier for each.

    min over lambda(s) >= 0 of max over pi of  E[A_r(s, a) - sum_k lambda_k(s) (Q_k(s, a) - d_k)]

lambda is a network of the state; where no policy keeps the limit it grows without bound, which marks the infeasible
states. Source: Ma et al. 2021, "Feasible Actor-Critic: Constrained Reinforcement Learning for Ensuring Statewise
Safety", sections 4 and 5.

Where this differs, and why:
- The paper's learner is off-policy (SAC); as in GUARD the policy takes the trust-region step of the other methods, and
  the multipliers one Adam step per epoch on the same batch, which makes them the slower of the two, as convergence
  requires. Q_k is the batch's discounted cost to go: what the cost critic is fitted to, without its lag.
- Adam works without momentum here. A multiplier that goes on rising after its cost has fallen makes the two swing: with
  GUARD's momentum of 0.9 the cost on the test's linear-quadratic problem swings between 0.74 and 1.39 times the limit,
  without between 0.9 and 1.1.
- A limit is given per episode, undiscounted, as for every other method. GUARD subtracts it from the discounted cost
  to go, which is another quantity (they agree only for its limit of 0). Here d_k is the discounted cost to go of
  a policy that spends the limit evenly: limit / episode length / (1 - gamma). That needs gamma < 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import torch
from torch import Tensor

from guard_algos import trust_region
from guard_algos.batch import Batch
from guard_algos.config import CostLimits, OnPolicyConfig
from guard_algos.constraints import Constraint
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem
from guard_algos.statewise_multiplier import StatewiseMultipliers
from guard_api.errors import SpecError


@dataclass(frozen=True, kw_only=True)
class TrpoFacConfig(OnPolicyConfig, CostLimits):
    """Options of TRPO-FAC."""

    multiplier_learning_rate: float = 1e-4
    """Adam learning rate of the multiplier networks, which take one step per epoch."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        super().__post_init__()
        if self.multiplier_learning_rate < 0:
            raise SpecError(f"multiplier_learning_rate = {self.multiplier_learning_rate}: must be at least 0")
        if self.gamma == 1:
            raise SpecError("gamma = 1.0: trpo-fac limits a discounted cost to go, set gamma below 1")


class TrpoFac(Method):
    """TRPO on A_r - sum_k lambda_k(s) A_c,k, then a step of dual ascent.

    A_r has unit variance in every batch, so a multiplier is in standard deviations of A_r per unit of cost, as
    TRPO-Lagrangian's is. It starts near softplus(0) = 0.7, as GUARD's does.
    """

    def __init__(self, config: TrpoFacConfig, problem: Problem) -> None:
        self._config, self._constraints = config, problem.constraints
        network = Mlp((problem.observation_size, *config.hidden, 1))
        rate = config.multiplier_learning_rate
        self._multipliers = StatewiseMultipliers(network, len(problem.constraints), rate, problem.generator)

    def tensors(self) -> dict[str, Tensor]:
        """Return the multiplier networks and their optimiser's state."""
        return {f"multiplier.{name}": tensor for name, tensor in self._multipliers.tensors().items()}

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate Lagrangian, then move the multipliers by the costs to go of the same batch."""
        penalty = (self._multipliers.predict(batch.observation, pool) * batch.cost_advantages).sum(dim=1)
        objective = trust_region.surrogate(batch.reward_advantage - penalty, batch.log_prob)
        report = trust_region.update(policy, theta, batch, self._config, pool, objective=objective)
        self._multipliers.ascend(batch.observation, excess(batch, self._constraints, self._config.gamma), pool)
        return report.row() | self._row(self._multipliers.predict(batch.observation, pool))

    def _row(self, values: Tensor) -> dict[str, float]:
        """Return the mean and the largest of the new multipliers (M, K) over the batch's states."""
        names = [constraint.name for constraint in self._constraints]
        mean, largest = values.double().mean(dim=0), values.amax(dim=0)
        return {f"multiplier_{name}": float(x) for name, x in zip(names, mean, strict=True)} | {
            f"multiplier_{name}_max": float(x) for name, x in zip(names, largest, strict=True)
        }


def excess(batch: Batch, constraints: Sequence[Constraint], gamma: float) -> Tensor:
    """Return Q_k - d_k (M, K): how far the cost to go from each of the batch's states is above its limit."""
    limits = torch.tensor([constraint.limit for constraint in constraints])
    return batch.targets[:, 1:] - limits / (float(batch.episodes.length.mean()) * (1 - gamma))


algorithm = OnPolicyAlgorithm(name="trpo-fac", config_type=TrpoFacConfig, method=TrpoFac)
