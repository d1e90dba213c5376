"""Interior-point Policy Optimization on a trust region: every limit is a logarithmic barrier in the objective.

    maximise  J(pi) + sum_k log(d_k - J_k(pi)) / t   subject to  E[KL(pi_old || pi)] <= delta

The policy stays inside the limits, and its return is at most K / t below the best one inside. Source: Liu, Ding and Liu
2020, "IPO: Interior-point Policy Optimization under Constraints", eq. 8-9 and theorem 1.

Where this differs from GUARD's code, and why:
- The barrier exists only where a policy can be strictly inside: a limit of 0, GUARD's, has no inside, as no cost is
  negative, and is refused. GUARD's barrier was never active; its runs maximised return - 0.0005 cost.
- A policy outside a limit first only lowers the exceeded costs, inside the barriers of the others, as an interior-point
  solver does in phase one (Boyd and Vandenberghe 2004, section 11.4), instead of paying that fixed penalty.
- A trial policy's cost is its old one plus episode length * mean(ratio * cost advantage), by the same surrogate as
  every other method here, instead of the product of a whole episode's likelihood ratios, which overflows.
- t is in the unit of the return, so that the theorem's K / t can be read as such; GUARD's 0.01 would give up 100.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos import trust_region
from guard_algos.batch import Batch
from guard_algos.config import CostLimits, OnPolicyConfig
from guard_algos.gaussian import GaussianPolicy
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem
from guard_algos.trust_region import Objective
from guard_api.errors import SpecError


@dataclass(frozen=True, kw_only=True)
class TrpoIpoConfig(OnPolicyConfig, CostLimits):
    """Options of TRPO-IPO."""

    barrier_t: float = 20.0
    """Steepness t of the barrier [1 / return]: each limit costs at most 1 / t of the return."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        super().__post_init__()
        if not self.barrier_t > 0:
            raise SpecError(f"barrier_t = {self.barrier_t}: must be positive")


class TrpoIpo(Method):
    """TRPO on the return with barriers, or on the exceeded costs until there are none."""

    def __init__(self, config: TrpoIpoConfig, problem: Problem) -> None:
        self._config, self._constraints = config, problem.constraints
        for constraint in problem.constraints:
            if not constraint.limit > 0:
                raise SpecError(
                    f"limit of {constraint.name!r} = {constraint.limit}: no cost can be below it, where the barrier of "
                    "trpo-ipo is: set a limit above 0"
                )

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate return inside the barriers; outside, lower the surrogate costs that are exceeded."""
        slack = -batch.margins
        objective = barred(batch, slack, self._config.barrier_t)
        report = trust_region.update(policy, theta, batch, self._config, pool, objective=objective)
        return report.row() | {"feasible": float((slack > 0).all())}


def barred(batch: Batch, slack: NDArray[np.float64], t: float) -> Objective:
    """Return the objective with a barrier at every limit that holds: NaN beyond one, which no line search accepts.

    slack: (K,), how far each mean cost per step is below its limit. Where all are positive this is
    mean(ratio A_r) + sum_k log(slack_k - mean(ratio A_c,k)) / (t u): u = episode length * reward_advantage_std turns
    t from the unit of an episode's return into that of A_r. Otherwise A_r is minus the sum of the exceeded costs'
    advantages, u is the length, and only the limits that hold are barriers.
    """
    inside, length = slack > 0, float(batch.episodes.length.mean())
    if inside.all():
        advantage, unit = batch.reward_advantage, length * max(batch.reward_advantage_std, 1e-8)
    else:
        advantage, unit = -batch.cost_advantages[:, torch.from_numpy(~inside)].sum(dim=1), length
    gain = trust_region.surrogate(advantage, batch.log_prob)
    barriers = [
        (float(slack[k]), trust_region.surrogate(batch.cost_advantages[:, k], batch.log_prob))
        for k in np.flatnonzero(inside)
    ]

    def objective(log_prob: Tensor) -> Tensor:
        value = gain(log_prob)
        for room, cost_change in barriers:
            value = value + torch.log(room - cost_change(log_prob)) / (t * unit)
        return value

    return objective


algorithm = OnPolicyAlgorithm(name="trpo-ipo", config_type=TrpoIpoConfig, method=TrpoIpo)
