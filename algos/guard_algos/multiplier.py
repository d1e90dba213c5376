"""Lagrange multipliers of the constraints, learned by dual ascent."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from guard_algos.constraints import Constraint


class Multipliers:
    """One multiplier >= 0 per constraint: lambda <- max(0, lambda + rate (J_c - limit)), once per epoch.

    Where the limit is 0 and costs are not negative, J_c - limit is never negative and a multiplier never falls. That is
    what dual ascent must do, because no finite multiplier solves such a problem; `maximum` bounds it for users who want
    that. Source: Ray et al. 2019, section 5; Zhao et al. 2024 (rate 0.005, no optimiser).
    """

    def __init__(self, constraints: Sequence[Constraint], rate: float, maximum: float | None) -> None:
        self.names = tuple(constraint.name for constraint in constraints)
        self.values: Tensor = torch.zeros(len(constraints), dtype=torch.float64)
        self._limits = torch.tensor([constraint.limit for constraint in constraints], dtype=torch.float64)
        self._rate, self._maximum = rate, maximum

    def ascend(self, episode_costs: Tensor) -> None:
        """Move every multiplier along its violation: `episode_costs` (K,) are the mean undiscounted episode sums."""
        self.values.add_(episode_costs - self._limits, alpha=self._rate).clamp_(min=0.0, max=self._maximum)

    def row(self) -> dict[str, float]:
        """Return the multipliers by the name of their column in the log."""
        return {f"multiplier_{name}": float(value) for name, value in zip(self.names, self.values, strict=True)}
