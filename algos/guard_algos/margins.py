"""How far each constraint is exceeded, in the unit in which an update models it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from guard_algos.batch import Batch
from guard_algos.constraints import Constraint


def margins(batch: Batch, constraints: Sequence[Constraint]) -> NDArray[np.float64]:
    """Return c (K,): the excess of the mean episode cost over its limit, per step, as the surrogate costs are.

    An episode's cost is undiscounted, the surrogate's advantage is discounted: the line search checks what that omits.
    Source: Achiam et al. 2017, section 6.1, with GUARD's division by the episode's length.
    """
    limits = np.array([constraint.limit for constraint in constraints])
    return (batch.episodes.constrained_costs.mean(axis=0) - limits) / batch.episodes.length.mean()
