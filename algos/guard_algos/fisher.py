"""Products with the Fisher matrix of a Gaussian policy, exact and without forming it."""

from __future__ import annotations

import torch
from torch import Tensor

from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import ROWS


class Fisher:
    """F = Hessian of the mean KL(old || new) at new = old: x -> F x + damping x over the batch's observations.

    For a diagonal Gaussian it is block diagonal: J^T diag(1/std^2) J / M for the network of the means, with J the
    Jacobian of all means, and 2 I for log_std. Source: Schulman et al. 2015, appendix C (Gauss-Newton form).
    """

    def __init__(self, policy: GaussianPolicy, theta: Tensor, observation: Tensor, damping: float) -> None:
        self._policy = policy
        self._parameters, log_std = policy.split(theta)
        self._precision = torch.exp(-2 * log_std) / len(observation)
        self._activations = [policy.network.activations(self._parameters, rows) for rows in observation.split(ROWS)]
        self._damping = damping

    def __call__(self, x: Tensor) -> Tensor:
        """Return (F + damping I) x (P,) for x (P,)."""
        network = self._policy.network
        direction, log_std_direction = self._policy.split(x)
        product = self._damping * x
        network_part, log_std_part = self._policy.split(product)
        for activations in self._activations:
            change = network.push(self._parameters, activations, direction)
            network.pull(self._parameters, activations, change * self._precision, out=network_part)
        log_std_part += 2 * log_std_direction
        return product
