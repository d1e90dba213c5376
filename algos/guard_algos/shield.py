"""What the two safety layers share: their options, when they begin to work, and what they report.

A safety layer stands between the policy and the environment: the policy proposes an action, the layer executes it or a
safer one. To the policy the layer is a piece of the environment, whose step is s' ~ P(. | s, layer(s, a)). So what is
executed has a return that is a return of the proposals, and its gradient is exactly

    E[grad log pi(a | s) A(s, a)]   with a the proposed action.

Therefore the proposed action and its probability enter the update, with the reward and the state that the executed one
led to. The executed action has no density to take a ratio of, because the layer sends whole regions onto a face; with
the value of pi there, a sample is weighed as if the policy had drawn it, and the gradient is biased. The papers' own
learners (DDPG, TD3) are off-policy: their critics judge an action whoever chose it, as the layers' models do here.
Source: Markgraf et al. 2025, "Safe Reinforcement Learning using Action Projection: Safeguard the Policy or the
Environment?", who call this the safe environment. GUARD's code updates in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from guard_algos.batch import Batch
from guard_algos.config import OnPolicyConfig
from guard_algos.constraints import SUM, Constraint
from guard_api.errors import SpecError, unknown_name


@dataclass(frozen=True, kw_only=True)
class ShieldConfig(OnPolicyConfig):
    """Options of both safety layers."""

    threshold: float = 0.0
    """What the layer keeps the sum of all costs at or below, where `thresholds` is empty: the cost of the next step
    (TRPO-SL), or the discounted costs to come (TRPO-USL). It is no limit of an episode's cost. At 0, as in GUARD, a
    layer acts wherever its model's error is positive, however small: a little more keeps more of the return."""
    thresholds: dict[str, float] = field(default_factory=dict)
    """The same for named costs, each with its own network; the other costs are only logged."""
    warmup_ratio: float = 1 / 3
    """Share of the training's steps in which the layer only learns; 1 never lets it work."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        super().__post_init__()
        if not 0 <= self.warmup_ratio <= 1:
            raise SpecError(f"warmup_ratio = {self.warmup_ratio}: must lie in [0, 1]")
        for name, value in {"threshold": self.threshold, **self.thresholds}.items():
            if not 0 <= value < np.inf:
                raise SpecError(f"threshold of {name!r} = {value}: must be finite and not negative")

    def signals(self, cost_names: Sequence[str]) -> tuple[Constraint, ...]:
        """Return the K sums of costs that the layer watches, with their thresholds as limits."""
        if not self.thresholds:
            return (Constraint(name=SUM, limit=self.threshold, columns=tuple(range(len(cost_names)))),)
        if self.threshold != 0:
            raise SpecError(f"threshold = {self.threshold} and thresholds of named costs: set only one")
        for name in self.thresholds:
            if name not in cost_names:
                raise unknown_name("cost in thresholds", name, cost_names)
        return tuple(
            Constraint(name=name, limit=limit, columns=(cost_names.index(name),))
            for name, limit in self.thresholds.items()
        )


class Warmup:
    """Counts the steps until the layer works: a share of the steps that the training was started with.

    A resumed training keeps the length it began with, so that asking for more steps does not switch the layer off.
    """

    def __init__(self, ratio: float, total_steps: int) -> None:
        self._seen = torch.zeros(1, dtype=torch.int64)
        length = int(np.ceil(ratio * total_steps)) if ratio < 1 else torch.iinfo(torch.int64).max
        self._length = torch.tensor([length])

    @property
    def over(self) -> bool:
        """Whether the layer works."""
        return bool(self._seen >= self._length)

    def advance(self, steps: int) -> None:
        """Count the steps of an epoch."""
        self._seen += steps

    def tensors(self) -> dict[str, Tensor]:
        """Return the live state."""
        return {"seen": self._seen, "length": self._length}


def clipped(action: Tensor) -> Tensor:
    """Return what an environment makes of an action: its nearest one in [-1, 1]^A."""
    return action.clamp(-1.0, 1.0)


def row(batch: Batch, working: bool, unmet: Tensor) -> dict[str, float]:
    """Return the layer's columns of the log of one epoch.

    shield_active: whether it worked. corrected_rate: share of steps whose action it changed. correction_mean: largest
    change of an action's component, mean over all steps. unmet_rate: share of steps whose executed action the layer's
    model, as it was while acting, puts above a threshold; `unmet` (M,).
    """
    change = (clipped(batch.rollout.executed) - clipped(batch.rollout.action)).abs().amax(dim=-1).double()
    return {
        "shield_active": float(working),
        "corrected_rate": float((change > 0).double().mean()),
        "correction_mean": float(change.mean()),
        "unmet_rate": float(unmet.double().mean()),
    }
