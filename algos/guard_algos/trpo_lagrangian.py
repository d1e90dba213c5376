"""TRPO-Lagrangian: TRPO on the Lagrangian of the constrained problem, with multipliers learned by dual ascent.

    max over pi, min over lambda >= 0   J_r(pi) - sum_k lambda_k (J_c,k(pi) - limit_k)

Source: Ray et al. 2019, "Benchmarking Safe Exploration in Deep Reinforcement Learning"; Bohez et al. 2019. With
no cost ever met, every step is TRPO's, bit for bit.

As in GUARD's code the objective is not divided by 1 + lambda, and a multiplier starts at 0 and moves once per epoch by
its rate times (mean episode cost - limit). With the limit of 0 of GUARD's runs it never falls; a limit above lets it.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import torch
from torch import Tensor

from guard_algos import trust_region
from guard_algos.batch import Batch
from guard_algos.config import CostLimits, OnPolicyConfig
from guard_algos.gaussian import GaussianPolicy
from guard_algos.multiplier import Multipliers
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem
from guard_api.errors import SpecError


@dataclass(frozen=True, kw_only=True)
class TrpoLagrangianConfig(OnPolicyConfig, CostLimits):
    """Options of TRPO-Lagrangian."""

    multiplier_rate: float = 0.005
    """Multiplier gained per epoch and unit of episode cost above the limit."""
    multiplier_max: float | None = None
    """Largest multiplier. None, as in GUARD, lets a limit of 0 raise it for ever."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        super().__post_init__()
        if self.multiplier_rate < 0 or (self.multiplier_max is not None and self.multiplier_max < 0):
            raise SpecError(
                f"multiplier_rate = {self.multiplier_rate}, multiplier_max = {self.multiplier_max}: must be at least 0"
            )


class TrpoLagrangian(Method):
    """TRPO on A = (A_r - sum_k lambda_k A_c,k) / (1 + sum_k lambda_k), then a step of dual ascent.

    The denominator changes no step, because a natural gradient has no scale; it keeps the logged improvement bounded.
    A_r has unit variance in every batch, so a multiplier is in standard deviations of A_r per unit of cost:
    multiplied by the logged `reward_advantage_std` it is in reward per cost.
    """

    def __init__(self, config: TrpoLagrangianConfig, problem: Problem) -> None:
        self._config = config
        self._multipliers = Multipliers(problem.constraints, config.multiplier_rate, config.multiplier_max)

    def tensors(self) -> dict[str, Tensor]:
        """Return the multipliers."""
        return {"multipliers": self._multipliers.values}

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate Lagrangian, then move the multipliers by the costs of the same batch's episodes."""
        objective = trust_region.surrogate(lagrangian(batch, self._multipliers.values), batch.log_prob)
        report = trust_region.update(policy, theta, batch, self._config, pool, objective=objective)
        self._multipliers.ascend(torch.from_numpy(batch.episodes.constrained_costs.mean(axis=0)))
        return report.row() | self._multipliers.row()


def lagrangian(batch: Batch, multipliers: Tensor) -> Tensor:
    """Return the advantage (M,) of the Lagrangian, normalised, for multipliers (K,)."""
    penalty = batch.cost_advantages @ multipliers.float()
    return (batch.reward_advantage - penalty) / (1 + multipliers.sum().float())


algorithm = OnPolicyAlgorithm(name="trpo-lagrangian", config_type=TrpoLagrangianConfig, method=TrpoLagrangian)
