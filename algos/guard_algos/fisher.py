"""A policy to first order about its parameters, and products with its Fisher matrix without forming it."""

from __future__ import annotations

from concurrent.futures import Executor

import torch
from torch import Tensor

from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import accumulate, pieces


class LocalPolicy:
    """The policy linearised at theta (P,) over observations (M, O): J is the Jacobian of all means (M, A).

    Fisher matrix F: the Hessian of the mean KL(old || new) at new = old. For a diagonal Gaussian it is block diagonal:
    J^T diag(1/std^2) J / M for the network of the means and 2 I for log_std. Source: Schulman et al. 2015, appendix C.
    """

    def __init__(self, policy: GaussianPolicy, theta: Tensor, observation: Tensor, pool: Executor) -> None:
        self._policy, self._pool = policy, pool
        self._parameters, log_std = (part.clone() for part in policy.split(theta))
        self._precision = torch.exp(-2 * log_std) / len(observation)
        sweep = pool.map(lambda rows: policy.network.activations(self._parameters, rows), pieces(observation))
        self._activations = list(sweep)

    def gradient(self, by_mean: Tensor, by_log_std: Tensor) -> Tensor:
        """Return the gradient (P,) of a function of the policy from its gradients by means (M, A) and log_std (A,)."""

        def add(activations: list[Tensor], cotangent: Tensor, out: Tensor) -> None:
            self._policy.network.pull(self._parameters, activations, cotangent, out)

        pulled = accumulate(self._pool, self._parameters, add, self._activations, pieces(by_mean))
        return torch.cat([pulled, by_log_std])

    def fisher(self, x: Tensor) -> Tensor:
        """Return F x (P,) for x (P,)."""
        network = self._policy.network
        direction, log_std_direction = self._policy.split(x)

        def add(activations: list[Tensor], out: Tensor) -> None:
            change = network.push(self._parameters, activations, direction)
            network.pull(self._parameters, activations, change * self._precision, out)

        product = accumulate(self._pool, self._parameters, add, self._activations)
        return torch.cat([product, 2 * log_std_direction])
