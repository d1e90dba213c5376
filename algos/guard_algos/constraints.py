"""Which columns of the environment's costs a constraint sums, and its limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guard_algos.config import CostLimits
from guard_api.errors import SpecError, unknown_name

SUM = "cost"
"""Name of the one constraint on the sum of all costs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Constraint:
    """A limit on the undiscounted episode sum of some `columns` of the environment's costs."""

    name: str
    limit: float
    columns: tuple[int, ...]


def resolve(limits: CostLimits, cost_names: Sequence[str]) -> tuple[Constraint, ...]:
    """Return the constraints that `limits` asks for, in the order of the environment's costs `cost_names`.

    Raises SpecError for an unknown cost, a limit that is negative or not finite, and for both kinds of limit at once.
    """
    if not limits.cost_limits:
        return (_constraint(SUM, limits.cost_limit, range(len(cost_names))),)
    if limits.cost_limit != 0:
        raise SpecError(
            f"cost_limit = {limits.cost_limit} limits the sum of all costs and cost_limits each named one: set only one"
        )
    for name in limits.cost_limits:
        if name not in cost_names:
            raise unknown_name("cost in cost_limits", name, cost_names)
    columns = [(column, name) for column, name in enumerate(cost_names) if name in limits.cost_limits]
    return tuple(_constraint(name, limits.cost_limits[name], [column]) for column, name in columns)


def reduce_costs(costs: NDArray[np.float64], constraints: Sequence[Constraint]) -> NDArray[np.float64]:
    """Return the constrained costs (..., K), one column per constraint, of the environment's costs (..., C)."""
    reduced = np.empty((*costs.shape[:-1], len(constraints)))
    for k, constraint in enumerate(constraints):
        reduced[..., k] = costs[..., list(constraint.columns)].sum(axis=-1)
    return reduced


def _constraint(name: str, limit: float, columns: Sequence[int]) -> Constraint:
    if not 0 <= limit < np.inf:
        raise SpecError(f"limit of {name!r} = {limit}: must be finite and not negative")
    return Constraint(name=name, limit=float(limit), columns=tuple(columns))
