"""One trust-region update of a policy: linearise, choose a direction, search along it, accept.

Every algorithm here is a choice of three functions: the objective, the direction and the acceptance rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos import conjugate_gradient
from guard_algos.batch import Batch
from guard_algos.config import OnPolicyConfig
from guard_algos.finite import finite
from guard_algos.fisher import Fisher
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
    *,
    objective: Objective,
    costs: Sequence[Objective] = (),
    margins: Sequence[float] = (),
    direction: Direction = natural,
    accept: Accept = improves,
) -> Report:
    """Move the parameters theta (P,) in place by one accepted step, or leave them.

    costs: K objectives that `direction` and `accept` keep low; margins: how far each constraint is exceeded.
    Raises NotFiniteError when a gradient or the step is not finite.
    """
    evaluation = _Evaluation(policy, theta, batch, (objective, *costs))
    gradients = evaluation.gradients()
    residuals: list[float] = []
    fisher = Fisher(policy, theta, batch.observation, config.cg_damping)

    def solve(b: Tensor) -> Tensor:
        solution = conjugate_gradient.solve(fisher, b, iterations=config.cg_iterations, tolerance=config.cg_tolerance)
        residuals.append(solution.residual)
        return solution.x

    model = LocalModel(
        gradient=finite(gradients[0], "gradient of the objective"),
        cost_gradients=tuple(finite(b, "gradient of a cost") for b in gradients[1:]),
        margins=np.asarray(margins, float),
        solve=solve,
        radius=config.target_kl,
    )
    step = direction(model)
    finite(step.delta, "policy step")
    accepted, trial, count = _line_search(evaluation, model, step, accept, config)
    return Report(
        accepted=accepted,
        trial=trial,
        line_search_steps=count,
        feasible=step.feasible,
        cg_residual=max(residuals, default=0.0),
    )


def _line_search(
    evaluation: _Evaluation, model: LocalModel, step: Step, accept: Accept, config: OnPolicyConfig
) -> tuple[bool, Trial, int]:
    """Try theta + factor^j step, j = 0, 1, ...; keep the first accepted one, else the old parameters."""
    trial, old = None, evaluation.theta.clone()
    for j in range(config.backtrack_steps):
        torch.add(old, step.delta, alpha=config.backtrack_factor**j, out=evaluation.theta)
        trial = evaluation.trial()
        if accept(trial, model, step):
            return True, trial, j + 1
    evaluation.theta.copy_(old)
    assert trial is not None
    return False, trial, config.backtrack_steps


class _Evaluation:
    """The objectives and the KL divergence as functions of `theta`, and their values at the old parameters."""

    def __init__(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, objectives: tuple[Objective, ...]) -> None:
        self.theta = theta
        self._policy, self._batch, self._objectives = policy, batch, objectives
        self._old = theta.clone()
        self._old_values = np.array([float(objective(batch.log_prob)) for objective in objectives])

    def gradients(self) -> list[Tensor]:
        """Return the gradient (P,) of every objective at the old parameters."""
        with torch.enable_grad():
            theta = self._old.clone().requires_grad_()
            mean = self._policy.mean(theta, self._batch.observation)
            log_prob = self._policy.log_prob(theta, mean, self._batch.action)
            values = [objective(log_prob) for objective in self._objectives]
        return [torch.autograd.grad(value, theta, retain_graph=True)[0] for value in values]

    def trial(self) -> Trial:
        """Return what the present `theta` does on the batch."""
        mean = self._policy.mean(self.theta, self._batch.observation)
        log_prob = self._policy.log_prob(self.theta, mean, self._batch.action)
        changes = np.array([float(objective(log_prob)) for objective in self._objectives]) - self._old_values
        return Trial(
            kl=float(self._policy.kl(self._old, self._batch.mean, self.theta, mean)),
            improvement=float(changes[0]),
            cost_changes=changes[1:],
        )
