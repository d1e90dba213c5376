"""Projection-Based Constrained Policy Optimization: a step for the return alone, then the nearest step that is allowed.

    y = argmax  g y             subject to  y F y / 2 <= delta
    x = argmin  |x - y|_L^2     subject to  c_k + b_k x <= 0

to first order in return and costs and second in KL, with L = F (the KL projection) or L = I (the L2 projection). For
one constraint x = y - max(0, (c + b y) / (b L^-1 b)) L^-1 b. Source: Yang et al. 2020, "Projection-Based Constrained
Policy Optimization", eq. 2-4.

GUARD's code takes x as it is. Here x is tried along its ray as CPO's step is, because from outside the limit x may lie
far outside the trust region in which c + b x means something: the ray lowers an exceeded cost all the way, and keeps a
satisfied one, so that a shortened step is still a safe one. Several constraints are projected onto together.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from guard_algos import trust_region
from guard_algos.batch import Batch
from guard_algos.config import CostLimits, OnPolicyConfig
from guard_algos.cpo import binding_sets, constrained_update, products, recovery
from guard_algos.gaussian import GaussianPolicy
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem
from guard_algos.trust_region import LocalModel, Step

Array = NDArray[np.float64]
Norm = Literal["kl", "l2"]


@dataclass(frozen=True, kw_only=True)
class PcpoConfig(OnPolicyConfig, CostLimits):
    """Options of PCPO."""

    projection: Norm = "kl"
    """Distance of the projection: `kl`, by the Fisher matrix, or `l2`, between parameters."""


class Pcpo(Method):
    """One natural-gradient step, its projection, and a line search per batch."""

    def __init__(self, config: PcpoConfig, problem: Problem) -> None:
        self._config = config

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate return, projected onto where the surrogate costs hold.

        The line search has CPO's rule, so that the two differ in their direction only.
        """
        norm = self._config.projection
        return constrained_update(policy, theta, batch, self._config, pool, lambda model: direction(model, norm))


def direction(model: LocalModel, norm: Norm) -> Step:
    """Return the natural step, projected; where the constraints contradict each other, CPO's recovering step.

    A constraint that has no gradient cannot be changed by a step and is left out.
    """
    y = trust_region.natural(model).delta
    movable = [k for k, b in enumerate(model.cost_gradients) if bool(b.any())]
    B, c = [model.cost_gradients[k] for k in movable], model.margins[movable]
    W = [model.solve(b) if norm == "kl" else b for b in B]
    nu = projection(products(B, W), c + np.array([float(b.dot(y)) for b in B]))
    feasible = nu is not None
    if nu is None:
        y, W = y.new_zeros(y.shape), [model.solve(b) for b in B]  # the ball's norm, whatever the projection's
        nu = recovery(products(B, W), c, model.radius)
    delta = y.clone()
    for weight, w in zip(nu, W, strict=True):
        delta.add_(w, alpha=-float(weight))
    return Step(delta, feasible)


def projection(S: Array, excess: Array) -> Array | None:
    """Return the multipliers nu (K,) of the projection x = y - sum_k nu_k L^-1 b_k, or None where no x is allowed.

    S_jk = b_j L^-1 b_k; excess: (K,) c + b y. The problem is convex: the set of binding constraints whose solution
    nu_A = S_A^-1 excess_A has nu >= 0 and violates no other constraint is the optimal one.
    """
    return next((nu for active in binding_sets(S) if (nu := _binding(S, excess, active)) is not None), None)


def _binding(S: Array, excess: Array, active: list[int]) -> Array | None:
    """Return the multipliers with exactly the `active` constraints binding, or None where that is not the optimum."""
    nu = np.zeros(len(excess))
    nu[active] = np.linalg.solve(S[np.ix_(active, active)], excess[active])
    left = excess - S @ nu
    left[active] = 0.0
    return nu if (nu >= 0).all() and (left <= 1e-9 * np.abs(excess)).all() else None


algorithm = OnPolicyAlgorithm(name="pcpo", config_type=PcpoConfig, method=Pcpo)
