"""One trust-region update of a policy: linearise, choose a direction, search along it, accept.

Every algorithm here is a choice of three functions: the objective, the direction and the acceptance rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from guard_algos.batch import Batch
from guard_algos.config import OnPolicyConfig
from guard_algos.finite import finite
from guard_algos.fisher import LocalPolicy
from guard_algos.gaussian import GaussianPolicy

Objective: TypeAlias = Callable[[Tensor], Tensor]
"""From the log-probabilities (M,) of the batch's actions under a trial policy to a scalar."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalModel:
    """The update's problem at the old parameters: objective and costs to first order, KL to second.

    Maximise g x subject to c_k + b_k x <= 0 and x F x / 2 <= radius.

    gradient: (P,) g. cost_gradients: K vectors b_k (P,). margins: (K,) c, how far each cost is above its limit, in the
    unit of the cost objectives. solve: x -> F^-1 x. radius: delta [nat].
    """

    gradient: Tensor
    cost_gradients: tuple[Tensor, ...]
    margins: NDArray[np.float64]
    solve: Callable[[Tensor], Tensor]
    radius: float


@dataclass(frozen=True, slots=True)
class Step:
    """A full step (P,) of the parameters, and whether the linearised constraints can hold within the trust region."""

    delta: Tensor
    feasible: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What a trial policy does on the batch: `kl` [nat], `improvement` of the objective, `cost_changes` (K,)."""

    kl: float
    improvement: float
    cost_changes: NDArray[np.float64]


Direction: TypeAlias = Callable[[LocalModel], Step]
Accept: TypeAlias = Callable[[Trial, LocalModel, Step], bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What one update did: `trial` is the last one tried, whose policy is kept only if `accepted`."""

    accepted: bool
    trial: Trial
    line_search_steps: int
    feasible: bool
    cg_residual: float

    def row(self) -> dict[str, float]:
        """Return the update's columns of the log: of the policy that was kept."""
        return {
            "kl": self.trial.kl if self.accepted else 0.0,
            "surrogate_improvement": self.trial.improvement if self.accepted else 0.0,
            "accepted": float(self.accepted),
            "line_search_steps": float(self.line_search_steps),
            "cg_residual": self.cg_residual,
        }


def surrogate(advantage: Tensor, old_log_prob: Tensor) -> Objective:
    """Return the objective mean(pi / pi_old * advantage) for `advantage` (M,). Source: Schulman et al. 2015, eq. 14."""
    return lambda log_prob: (torch.exp(log_prob - old_log_prob) * advantage).double().mean()


def natural(model: LocalModel) -> Step:
    """Return the step along F^-1 g to the border of the trust region, and none for a zero gradient.

    Source: Schulman et al. 2015, appendix C.
    """
    v = model.solve(model.gradient)
    q = float(model.gradient.dot(v))
    return Step(v * (2 * model.radius / q) ** 0.5 if q > 0 else torch.zeros_like(v))


def improves(trial: Trial, model: LocalModel, step: Step) -> bool:
    """Accept a trial inside the trust region that does not lower the objective. Source: `natural`'s."""
    return trial.kl <= model.radius and trial.improvement >= 0


def update(
    policy: GaussianPolicy,
    theta: Tensor,
    batch: Batch,
    config: OnPolicyConfig,
    pool: Executor,
    *,
    objective: Objective,
    costs: Sequence[Objective] = (),
    margins: ArrayLike = (),
    direction: Direction = natural,
    accept: Accept = improves,
) -> Report:
    """Move the parameters theta (P,) in place by one accepted step, or leave them.

    costs: K objectives that `direction` and `accept` keep low; margins: how far each constraint is exceeded.
    Raises NotFiniteError when a gradient or the step is not finite.
    """
    old, objectives = theta.clone(), (objective, *costs)
    local = LocalPolicy(policy, theta, batch.observation, pool)
    gradient, *cost_gradients = (_gradient(policy, theta, batch, local, f) for f in objectives)
    solver = _Solver(local, config)
    model = LocalModel(
        gradient=finite(gradient, "gradient of the objective"),
        cost_gradients=tuple(finite(b, "gradient of a cost") for b in cost_gradients),
        margins=np.asarray(margins, float),
        solve=solver,
        radius=config.target_kl,
    )
    step = direction(model)
    accepted, trial, count = _line_search(
        theta,
        finite(step.delta, "policy step"),
        evaluate=lambda: _evaluate(policy, old, theta, batch, objectives, pool),
        accept=lambda trial: accept(trial, model, step),
        config=config,
    )
    return Report(
        accepted=accepted, trial=trial, line_search_steps=count, feasible=step.feasible, cg_residual=solver.residual
    )


class _Solver:
    """b -> (F + damping I)^-1 b by conjugate gradient; `residual` is the largest relative one so far."""

    def __init__(self, local: LocalPolicy, config: OnPolicyConfig) -> None:
        self._local, self._config = local, config
        self.residual = 0.0

    def __call__(self, b: Tensor) -> Tensor:
        config = self._config
        solution = conjugate_gradient(
            lambda x: self._local.fisher(x).add_(x, alpha=config.cg_damping),
            b,
            iterations=config.cg_iterations,
            tolerance=config.cg_tolerance,
        )
        self.residual = max(self.residual, solution.residual)
        return solution.x


@dataclass(frozen=True, slots=True)
class Solution:
    """`x` (P,), the relative `residual` |A x - b| / |b| that the recursion reports, and the `iterations` taken."""

    x: Tensor
    residual: float
    iterations: int


def conjugate_gradient(
    product: Callable[[Tensor], Tensor], b: Tensor, *, iterations: int, tolerance: float
) -> Solution:
    """Return an approximate solution of A x = b (P,) by at most `iterations` products x -> A x.

    Stops at a relative residual of `tolerance`. b = 0 gives x = 0. Source: Nocedal and Wright 2006, algorithm 5.2.
    """
    x, r, p = torch.zeros_like(b), b.clone(), b.clone()
    rr = start = float(r.dot(r))
    count = 0
    while count < iterations and rr > tolerance**2 * start:
        product_p = product(p)
        alpha = rr / float(p.dot(product_p))
        x.add_(p, alpha=alpha)
        r.sub_(product_p, alpha=alpha)
        rr, previous = float(r.dot(r)), rr
        p.mul_(rr / previous).add_(r)
        count += 1
    return Solution(x, (rr / start) ** 0.5 if start > 0 else 0.0, count)


def _line_search(
    theta: Tensor,
    delta: Tensor,
    evaluate: Callable[[], Trial],
    accept: Callable[[Trial], bool],
    config: OnPolicyConfig,
) -> tuple[bool, Trial, int]:
    """Move theta by factor^j delta, j = 0, 1, ..., to the first accepted trial, or back; return the last trial too."""
    old, count = theta.clone(), 0
    while True:
        torch.add(old, delta, alpha=config.backtrack_factor**count, out=theta)
        trial = evaluate()
        count += 1
        if accept(trial):
            return True, trial, count
        if count == config.backtrack_steps:
            theta.copy_(old)
            return False, trial, count


def _gradient(policy: GaussianPolicy, theta: Tensor, batch: Batch, local: LocalPolicy, objective: Objective) -> Tensor:
    """Return the gradient (P,) of `objective` at the old parameters."""
    mean = batch.mean.detach().requires_grad_()
    log_std = policy.split(theta)[1].clone().requires_grad_()
    with torch.enable_grad():
        value = objective(policy.log_prob(log_std, mean, batch.action))
    return local.gradient(*torch.autograd.grad(value, (mean, log_std)))


def _evaluate(
    policy: GaussianPolicy, old: Tensor, theta: Tensor, batch: Batch, objectives: Sequence[Objective], pool: Executor
) -> Trial:
    """Return what the policy `theta` does on the batch that `old` collected."""
    log_std, mean = policy.split(theta)[1], policy.means(theta, batch.observation, pool)
    log_prob = policy.log_prob(log_std, mean, batch.action)
    changes = np.array([float(objective(log_prob) - objective(batch.log_prob)) for objective in objectives])
    return Trial(
        kl=float(policy.kl(policy.split(old)[1], batch.mean, log_std, mean)),
        improvement=float(changes[0]),
        cost_changes=changes[1:],
    )
