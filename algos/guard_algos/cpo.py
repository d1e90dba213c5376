"""Constrained Policy Optimization: the largest improvement of return in a KL ball that keeps costs below their limits.

    maximise  g x   subject to  c_k + b_k x <= 0  and  x F x / 2 <= delta

to first order in return and costs and second in KL; where no step in the ball satisfies the costs, the step that
reduces their violation most. Source: Achiam et al. 2017, "Constrained Policy Optimization", eq. 10-14.

GUARD's code solves the dual of one constraint by the cases of theorem 2. Here the set of constraints that bind is
tried, which is the same step for one, holds for several, and does not divide by a margin c of 0. While no step in the
ball keeps the limits, its line search asks that the surrogate cost does not rise; here that all violations together do
not, since of several costs one may have to rise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls, root_scalar
from torch import Tensor

from guard_algos import trust_region
from guard_algos.batch import Batch
from guard_algos.config import CostLimits, OnPolicyConfig
from guard_algos.gaussian import GaussianPolicy
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem
from guard_algos.trust_region import Direction, LocalModel, Step, Trial

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CpoConfig(OnPolicyConfig, CostLimits):
    """Options of CPO."""


class Cpo(Method):
    """One constrained natural-gradient step with a line search per batch."""

    def __init__(self, config: CpoConfig, problem: Problem) -> None:
        self._config = config

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate return while the surrogate costs hold, or lower the costs where they cannot."""
        return constrained_update(policy, theta, batch, self._config, pool, direction)


def constrained_update(
    policy: GaussianPolicy, theta: Tensor, batch: Batch, config: OnPolicyConfig, pool: Executor, direction: Direction
) -> dict[str, float]:
    """Search along `direction` for a step that `accept` takes, with a surrogate for every cost; return its row."""
    report = trust_region.update(
        policy,
        theta,
        batch,
        config,
        pool,
        objective=trust_region.surrogate(batch.reward_advantage, batch.log_prob),
        costs=[trust_region.surrogate(advantage, batch.log_prob) for advantage in batch.cost_advantages.T],
        margins=batch.margins,
        direction=direction,
        accept=accept,
    )
    return report.row() | {"feasible": float(report.feasible)}


def direction(model: LocalModel) -> Step:
    """Return the optimal step, or the recovering one where the constraints cannot hold in the trust region.

    It lies in the span of v = F^-1 g and w_k = F^-1 b_k, so that only their products matter:
    x = alpha v - sum_k beta_k w_k. A constraint that has no gradient cannot be changed by a step and is left out.
    """
    v, W = model.solve(model.gradient), [model.solve(b) for b in model.cost_gradients]
    q = float(model.gradient.dot(v))
    r = np.array([float(b.dot(v)) for b in model.cost_gradients])
    S = products(model.cost_gradients, W)
    movable = np.flatnonzero(np.diag(S) > 0.0)
    c, r, S = model.margins[movable], r[movable], S[np.ix_(movable, movable)]
    coefficients = optimum(q, r, S, c, model.radius)
    feasible = coefficients is not None
    alpha, beta = coefficients if coefficients is not None else (0.0, recovery(S, c, model.radius))
    delta = alpha * v
    for k, weight in zip(movable, beta, strict=True):
        delta = delta - float(weight) * W[k]
    return Step(delta, feasible)


def optimum(q: float, r: Array, S: Array, c: Array, radius: float) -> tuple[float, Array] | None:
    """Return (alpha, beta (K,)) of the optimal step, or None where no step is feasible.

    q = g F^-1 g, r_k = b_k F^-1 g, S_jk = b_j F^-1 b_k. With the constraints A binding and multipliers lambda of the
    ball and nu of the costs, alpha = 1 / lambda and beta = nu / lambda, where
    lambda^2 = (q - r_A S_A^-1 r_A) / (2 radius - c_A S_A^-1 c_A) and nu_A = S_A^-1 (r_A + lambda c_A).
    The problem is convex: the set A whose solution has nu >= 0 and violates no other constraint is the optimal one.
    With one constraint this is Achiam et al. 2017, theorem 2.
    """
    return next((step for A in binding_sets(S) if (step := _binding(q, r, S, c, radius, A)) is not None), None)


def _binding(q: float, r: Array, S: Array, c: Array, radius: float, active: list[int]) -> tuple[float, Array] | None:
    """Return the step with exactly the `active` constraints binding, or None where it is not the optimum."""
    S_A, r_A, c_A = S[np.ix_(active, active)], r[active], c[active]
    inverse_r, inverse_c = np.linalg.solve(S_A, r_A), np.linalg.solve(S_A, c_A)
    room, gain = 2 * radius - c_A @ inverse_c, q - r_A @ inverse_r
    if room < 0:
        return None
    # Without gain nothing is left to improve beside the binding constraints: the nearest point on them is optimal.
    gain = gain if gain > 1e-12 * q else 0.0
    alpha = float(np.sqrt(room / gain)) if gain > 0 else 0.0
    beta = np.zeros(len(c))
    beta[active] = alpha * inverse_r + inverse_c
    nu = np.sqrt(room) * inverse_r + np.sqrt(gain) * inverse_c
    excess = c + alpha * r - S @ beta
    excess[active] = 0.0
    tolerance = 1e-9 * (np.abs(c) + np.sqrt(2 * radius * np.diag(S)))
    return (alpha, beta) if (nu >= 0).all() and (excess <= tolerance).all() else None


def products(B: Sequence[Tensor], W: Sequence[Tensor]) -> Array:
    """Return S (K, K), S_jk = b_j w_k, of K gradients and w_k = L^-1 b_k: the nearest that such products can be.

    The solver's error makes them unsymmetric, and those of nearly parallel gradients indefinite, which no step is
    optimal for; so what lies below zero, in units that make the diagonal ones, is cut off.
    """
    S = np.array([[float(b.dot(w)) for w in W] for b in B]).reshape(len(B), len(W))
    length = np.sqrt(np.maximum(np.diag(S), 0.0))
    scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    values, vectors = np.linalg.eigh((S + S.T) / 2 * np.outer(scale, scale))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(length, length)


def binding_sets(S: Array) -> Iterator[list[int]]:
    """Yield every set of constraints that may bind together: whose gradients, of products `S`, are independent.

    Whatever their units: the products are scaled to a diagonal of ones. Small sets come first.
    """
    scale = 1.0 / np.sqrt(np.diag(S))
    cosines = S * np.outer(scale, scale)
    for size in range(len(S) + 1):
        for members in combinations(range(len(S)), size):
            active = list(members)
            if not active or np.linalg.matrix_rank(cosines[np.ix_(active, active)], hermitian=True) == size:
                yield active


def recovery(S: Array, c: Array, radius: float) -> Array:
    """Return beta (K,) of the step x = -sum_k beta_k F^-1 b_k on the border of the ball that violates least.

    It minimises |max(0, c + b x)|^2 over the ball. With one constraint beta = sqrt(2 radius / S), the recovery step of
    Achiam et al. 2017, eq. 14. Its dual is a non-negative least squares problem for each multiplier m of the ball,
    min over u >= 0 of u S u / 2 + m u u / 2 - c u, whose step -W u shrinks as m grows: m is found by bisection.
    """
    scale = float(np.trace(S))

    def dual(log_multiplier: float) -> Array:
        L = np.linalg.cholesky(S + scale * np.exp(log_multiplier) * np.eye(len(c)))
        return nnls(L.T, np.linalg.solve(L, c))[0]

    def excess(log_multiplier: float) -> float:
        u = dual(log_multiplier)
        return float(u @ S @ u - 2 * radius)

    low = high = float(np.log(1e-9))
    if excess(low) <= 0:  # the constraints contradict each other, and the least violation lies inside the ball
        return dual(low)
    while excess(high) > 0:
        high += 2.0
    u = dual(root_scalar(excess, bracket=(low, high)).root)
    return u * np.sqrt(2 * radius / (u @ S @ u))


def accept(trial: Trial, model: LocalModel, step: Step) -> bool:
    """Accept a trial in the trust region that keeps the costs, and the objective where no cost is exceeded.

    A cost above its limit must not rise, one below it may rise by its slack. The objective may fall only where that is
    the price of a cost above its limit. While recovering, the violation of all costs together must not grow: some may
    have to rise for others to fall. Source: Achiam et al. 2017, section 6.1.
    """
    if not trial.kl <= model.radius:
        return False
    if step.feasible:
        within = bool((trial.cost_changes <= np.maximum(-model.margins, 0.0)).all())
        return within and (trial.improvement >= 0 or bool((model.margins > 0).any()))
    violation = np.maximum(model.margins + trial.cost_changes, 0.0)
    return bool(np.linalg.norm(violation) <= np.linalg.norm(np.maximum(model.margins, 0.0)))


algorithm = OnPolicyAlgorithm(name="cpo", config_type=CpoConfig, method=Cpo)
