"""Dry friction of joints: the force within its bounds that brings each joint nearest to rest within a timestep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api.model.dynamics import solve

Array = NDArray[np.float64]

_SWEEPS = 60
"""Passes over joints that rub at once: a fixed number, since stopping early would let worlds influence each other."""


def rubbed(matrix: Array, right: Array, speed: Array, loss: Array, timestep: float) -> Array:
    """Return the acceleration (D, N) of matrix a = right + friction, with friction in +-`loss` (D,).

    matrix (D, D, N) and right (D, N) as from `Dynamics.equations`; speed: (D, N) at the beginning of the timestep.
    Exact for one joint that rubs, else by projected Gauss-Seidel iteration.
    """
    rubbing = np.flatnonzero(loss)
    pulls = np.zeros((len(right), 1 + len(rubbing), right.shape[1]))
    pulls[:, 0] = right
    pulls[rubbing, 1 + np.arange(len(rubbing))] = 1.0
    solution = solve(matrix, pulls)
    acceleration, response = solution[:, 0].copy(), solution[:, 1:]
    friction = np.zeros((len(rubbing), right.shape[1]))
    for _ in range(_SWEEPS if len(rubbing) > 1 else 1):
        for k, joint in enumerate(rubbing):
            stopping = -(speed[joint] / timestep + acceleration[joint]) / response[joint, k]
            bounded = np.clip(friction[k] + stopping, -loss[joint], loss[joint])
            acceleration += response[:, k] * (bounded - friction[k])
            friction[k] = bounded
    return acceleration
