"""The stochastic policy: a diagonal Gaussian whose mean is a network and whose standard deviation is a parameter."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass

import torch
from torch import Tensor

from guard_algos.networks import Mlp

_LOG_SQRT_2PI = 0.5 * math.log(2 * math.pi)


@dataclass(frozen=True, slots=True)
class GaussianPolicy:
    """pi(a | s) = N(network(s), diag(exp(log_std))^2) with parameters theta (P,): the network's, then log_std (A,).

    The functions take theta, so that a trial policy of a line search is a vector and nothing else.
    """

    network: Mlp

    @property
    def action_size(self) -> int:
        """Number of actions A."""
        return self.network.sizes[-1]

    def init(self, generator: torch.Generator, log_std: float) -> Tensor:
        """Return initial parameters theta (P,)."""
        return torch.cat([self.network.init(generator), torch.full((self.action_size,), log_std)])

    def split(self, theta: Tensor) -> tuple[Tensor, Tensor]:
        """Return views of theta: the network's parameters and log_std (A,)."""
        return theta[: -self.action_size], theta[-self.action_size :]

    def mean(self, theta: Tensor, observation: Tensor) -> Tensor:
        """Return the mean actions (M, A) at observations (M, O)."""
        return self.network.forward(self.split(theta)[0], observation)

    def means(self, theta: Tensor, observation: Tensor, pool: Executor) -> Tensor:
        """Return `mean` of a large batch (M, O), by the threads of `pool`."""
        return self.network.outputs(self.split(theta)[0], observation, pool)

    def act(self, theta: Tensor, observation: Tensor, noise: Tensor) -> Tensor:
        """Return sampled actions (M, A) at observations (M, O), from standard normal `noise` (M, A)."""
        return self.mean(theta, observation) + torch.exp(self.split(theta)[1]) * noise

    @staticmethod
    def log_prob(log_std: Tensor, mean: Tensor, action: Tensor) -> Tensor:
        """Return log pi(a | s) (M,) of actions (M, A) under log_std (A,) and the means (M, A)."""
        z = (action - mean) * torch.exp(-log_std)
        return (-0.5 * z.square() - log_std - _LOG_SQRT_2PI).sum(-1)

    @staticmethod
    def kl(old_log_std: Tensor, old_mean: Tensor, new_log_std: Tensor, new_mean: Tensor) -> Tensor:
        """Return the mean over samples of KL(old || new) [nat], a scalar, from log_std (A,) and means (M, A) of both.

        The part of the standard deviations uses expm1, which keeps its digits when the policies are close.
        """
        narrowing = (new_log_std - old_log_std).double()
        spread = (narrowing + 0.5 * torch.expm1(-2 * narrowing)).sum()
        shift = ((new_mean - old_mean).double() * torch.exp(-new_log_std.double())).square().sum(-1).mean()
        return spread + 0.5 * shift

    def entropy(self, theta: Tensor) -> float:
        """Return the entropy [nat] of the action at any observation."""
        return float((self.split(theta)[1].double() + 0.5 + _LOG_SQRT_2PI).sum())
