"""The formulas behind the log, written again in NumPy and float64, from their definitions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

Array = np.ndarray
STEP = 1e-30
"""Imaginary step of a derivative: exact to the last digit, because nothing is subtracted."""


class Gaussian:
    """N(network(s), diag(exp(log_std))^2) with parameters theta (P,): weights and biases layer by layer, log_std."""

    def __init__(self, theta: Array, sizes: Sequence[int]) -> None:
        self.theta, self.sizes = np.asarray(theta, np.float64), tuple(sizes)
        self.log_std = self.theta[-self.sizes[-1] :]

    def mean(self, x: Array) -> Array:
        """Return the mean actions (M, A) at observations (M, O)."""
        return network(self.theta[: -self.sizes[-1]], self.sizes, x)

    def log_prob(self, x: Array, action: Array) -> Array:
        """Return log pi(a | s) (M,)."""
        variance = np.exp(2 * self.log_std)
        return -0.5 * ((action - self.mean(x)) ** 2 / variance + np.log(2 * np.pi * variance)).sum(axis=1)

    def entropy(self) -> float:
        """Return the entropy of an action [nat]."""
        return float(0.5 * np.log(2 * np.pi * np.e * np.exp(2 * self.log_std)).sum())

    def kl(self, new: Gaussian, x: Array) -> float:
        """Return the mean over x (M, O) of KL(self || new) [nat]."""
        old_variance, new_variance = np.exp(2 * self.log_std), np.exp(2 * new.log_std)
        distance = (new.mean(x) - self.mean(x)) ** 2
        terms = np.log(new_variance / old_variance) + (old_variance + distance) / new_variance - 1
        return float(0.5 * terms.sum(axis=1).mean())

    def moved(self, step: Array) -> Gaussian:
        """Return the policy whose parameters are further by `step` (P,)."""
        return Gaussian(self.theta + step, self.sizes)

    def fisher(self, x: Array) -> Array:
        """Return the Fisher matrix (P, P), the mean over x of the outer products of the score's parts."""
        actions = self.sizes[-1]
        count = len(self.theta) - actions
        directions = self.theta[:count] + 1j * STEP * np.eye(count)
        slopes = np.stack([np.imag(network(direction, self.sizes, x)) / STEP for direction in directions], axis=-1)
        matrix = np.zeros((len(self.theta), len(self.theta)))
        matrix[:count, :count] = np.einsum("map,a,maq->pq", slopes, np.exp(-2 * self.log_std), slopes) / len(x)
        matrix[count:, count:] = 2 * np.eye(actions)
        return matrix


def network(parameters: Array, sizes: Sequence[int], x: Array) -> Array:
    """Return the outputs (M, out) of a network with tanh layers."""
    start, value = 0, np.asarray(x, np.float64)
    for layer, (a, b) in enumerate(pairwise(sizes)):
        weight, bias = parameters[start : start + a * b].reshape(b, a), parameters[start + a * b : start + a * b + b]
        value = value @ weight.T + bias
        value = np.tanh(value) if layer < len(sizes) - 2 else value
        start += a * b + b
    return value


def to_go(signal: Array, value: Array, after: Array, ended: Array, discount: float, weight: float) -> Array:
    """Return the generalised advantages (T, N): sums of discounted one-step errors up to the end of the episode.

    signal, value: (T, N). after: (T, N), the value of the true observation after each step. ended: (T, N).
    """
    T, N = signal.shape
    result = np.zeros((T, N))
    for t, n in np.ndindex(T, N):
        for s in range(t, T):
            result[t, n] += (discount * weight) ** (s - t) * (signal[s, n] + discount * after[s, n] - value[s, n])
            if ended[s, n]:
                break
    return result
