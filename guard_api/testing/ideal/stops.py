"""Hard stops without rebound: the impulses that keep joints within their limits, felt by the whole robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def inelastic(matrix: Array, free: Array, J: Array, least: Array) -> Array:
    """Return the velocity (D,) that impulses along the rows of `J` (C, D) make of `free` (D,), so that J u >= least.

    matrix: (D, D) inertia. least: (C,). The impulses only push, and one that pushes holds its row at `least` exactly,
    which is an inelastic impact. Rows that would have to pull are let go, the strongest first, and rows that others
    then violate are taken in; a mechanism of a dozen constraints settles within as many changes.
    """
    response = np.linalg.solve(matrix, J.T)
    held: list[int] = np.flatnonzero(J @ free < least).tolist()
    velocity = free
    for _ in range(4 * len(J)):
        impulse = np.linalg.solve(J[held] @ response[:, held], least[held] - J[held] @ free)
        if held and impulse.min() < 0.0:
            del held[int(np.argmin(impulse))]
            continue
        velocity = free + response[:, held] @ impulse
        slack = J @ velocity - least
        slack[held] = 0.0
        if slack.min(initial=0.0) >= -1e-12 * np.abs(velocity).max():
            break
        held.append(int(np.argmin(slack)))
    return velocity


def stopped(matrix: Array, velocity: Array, position: Array, lower: Array, upper: Array, timestep: float) -> Array:
    """Return the velocities (D, N) with which no joint ends the timestep beyond its limits.

    matrix (D, D, N) as from `Dynamics.equations`; velocity (D, N) without stops; position (J, N) at the beginning of
    the timestep; lower, upper: (J,). World i is looked at alone, so that it gets the same bits whatever N is.
    """
    base = len(velocity) - len(position)
    end = position + timestep * velocity[base:]
    velocity = velocity.copy()
    for i in np.flatnonzero(((end < lower[:, None]) | (end > upper[:, None])).any(axis=0)):
        if not np.isfinite(velocity[:, i]).all() or not np.isfinite(matrix[..., i]).all():
            continue  # that world has diverged, and is reported as such
        bounds = np.concatenate([lower - position[:, i], position[:, i] - upper]) / timestep
        limited = np.flatnonzero(np.isfinite(bounds))
        unit = np.eye(len(velocity))[base:]
        J = np.concatenate([unit, -unit])[limited]
        velocity[:, i] = inelastic(matrix[..., i], velocity[:, i], J, bounds[limited])
    return velocity
