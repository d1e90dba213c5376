"""Which of a training's policies is kept as the best one.

The rule: of the epochs whose mean episode costs are within all limits, the one of the largest mean return; while there
is none, the one of the smallest sum of mean constrained costs. Without limits it is the largest mean return. An epoch's
means are those of the policy that collected it, before its update, with sampled actions. The best of many noisy means
is partly luck: compare methods by their last policies, and evaluate the best one on episodes of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from guard_algos.constraints import Constraint
from guard_algos.episodes import Episodes


@dataclass(frozen=True, slots=True, order=True)
class Standing:
    """How good an epoch's policy was; the larger one is better. merit: mean return within the limits, else - cost."""

    within: bool
    merit: float


def standing(episodes: Episodes, constraints: Sequence[Constraint]) -> Standing:
    """Return how good the policy was that played `episodes`."""
    costs = episodes.constrained_costs.mean(axis=0)
    within = bool((costs <= np.array([constraint.limit for constraint in constraints])).all())
    return Standing(within, float(episodes.returns.mean()) if within else -float(costs.sum()))
