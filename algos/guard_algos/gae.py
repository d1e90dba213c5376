"""Generalised advantage estimation over a rollout in which episodes end at different times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def advantages(
    signal: Array, value: Array, next_value: Array, ended: NDArray[np.bool_], discount: float, weight: float
) -> Array:
    """Return A_t = sum_k (discount weight)^k delta_{t+k} (T, N, K), with delta_t = x_t + discount V(s_{t+1}) - V(s_t).

    signal: (T, N, K) rewards and costs x; value: (T, N, K) of the observation before the step; next_value: (T, N, K) of
    the true observation after it: of the episode's last one where it was truncated or the rollout ends, 0 where it
    terminated. ended: (T, N), where the sum stops. Source: Schulman et al. 2016, eq. 16.

    With weight 1, A + V is the discounted sum of the signal, bootstrapped at a truncation: the critics' target.
    """
    delta = signal + discount * next_value - value
    carry = (discount * weight * ~ended)[..., None]
    result = np.empty_like(delta)
    running = np.zeros_like(delta[0])
    for t in reversed(range(len(delta))):
        running = delta[t] + carry[t] * running
        result[t] = running
    return result
