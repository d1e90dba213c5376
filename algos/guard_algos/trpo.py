"""Trust Region Policy Optimization: the largest improvement of return within a KL ball.

    maximise  E[pi / pi_old A_r]   subject to  E[KL(pi_old || pi)] <= delta

Costs are logged and have no influence. Source: Schulman et al. 2015, "Trust Region Policy Optimization".

GUARD's code takes the same step and the same line search, on a Fisher matrix without damping; `OnPolicyConfig` says
what that does, and its preset `paper` brings it back.
"""

from __future__ import annotations

from concurrent.futures import Executor

from torch import Tensor

from guard_algos import trust_region
from guard_algos.batch import Batch
from guard_algos.config import OnPolicyConfig
from guard_algos.gaussian import GaussianPolicy
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem


class Trpo(Method):
    """One natural-gradient step with a line search per batch."""

    def __init__(self, config: OnPolicyConfig, problem: Problem) -> None:
        self._config = config

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate return."""
        objective = trust_region.surrogate(batch.reward_advantage, batch.log_prob)
        return trust_region.update(policy, theta, batch, self._config, pool, objective=objective).row()


algorithm = OnPolicyAlgorithm(name="trpo", config_type=OnPolicyConfig, method=Trpo)
