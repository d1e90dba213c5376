"""Statistics of the episodes that finished within a rollout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guard_algos.constraints import Constraint, reduce_costs
from guard_algos.rollout import Rollout

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Episodes:
    """Undiscounted sums over the E finished episodes; those that the end of the rollout cut are left out.

    returns: (E,). costs: (E, C). constrained_costs: (E, K). successes: (E,), steps that achieved the task.
    length: (E,) [steps].
    """

    returns: Array
    costs: Array
    constrained_costs: Array
    successes: Array
    length: Array

    def row(self, cost_names: Sequence[str]) -> dict[str, float]:
        """Return the episodes' columns of the log."""
        cost = self.costs.mean(axis=0)
        return {
            "episodes": float(len(self.returns)),
            "episode_length": float(self.length.mean()),
            "return_mean": float(self.returns.mean()),
            "return_std": float(self.returns.std()),
            "return_min": float(self.returns.min()),
            "return_max": float(self.returns.max()),
            "cost_mean": float(cost.sum()),
            **{f"cost_{name}": float(value) for name, value in zip(cost_names, cost, strict=True)},
            "success_mean": float(self.successes.mean()),
        }


def finished(rollout: Rollout, constraints: Sequence[Constraint]) -> Episodes:
    """Return the statistics of the episodes that finished within `rollout`."""
    costs = _sums(rollout.costs, rollout.ended)
    return Episodes(
        returns=_sums(rollout.reward, rollout.ended),
        costs=costs,
        constrained_costs=reduce_costs(costs, constraints),
        successes=_sums(rollout.success.astype(float), rollout.ended),
        length=_sums(np.ones(rollout.ended.shape), rollout.ended),
    )


def _sums(values: Array, ended: NDArray[np.bool_]) -> Array:
    """Return the sums (E, ...) of `values` (T, N, ...) over each finished episode, by world and then time."""
    ends = np.ascontiguousarray(ended.T)
    begins = np.ones_like(ends)
    begins[:, 1:] = ends[:, :-1]
    starts = np.flatnonzero(begins)
    stops = np.append(starts[1:], ends.size) - 1
    by_world = np.swapaxes(values, 0, 1).reshape(ends.size, *values.shape[2:])
    return np.add.reduceat(by_world, starts, axis=0)[ends.ravel()[stops]]
