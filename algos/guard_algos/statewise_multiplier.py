"""Lagrange multipliers that depend on the state: a network for each constraint, learned by dual ascent."""

from __future__ import annotations

from concurrent.futures import Executor

import torch
from torch import Tensor
from torch.nn.functional import softplus

from guard_algos.adam import Adam
from guard_algos.finite import finite
from guard_algos.networks import Mlp, accumulate, pieces


class StatewiseMultipliers:
    """lambda_k(s) = softplus(network_k(s)) > 0 for each of K constraints.

    All networks start with the same parameters, so that the order of the constraints means nothing. Adam has no
    momentum, which would carry a multiplier past its constraint.
    """

    def __init__(self, network: Mlp, num_constraints: int, learning_rate: float, generator: torch.Generator) -> None:
        self._network = network
        self._parameters = network.init(generator).repeat(num_constraints)
        self._adam = Adam(self._parameters, learning_rate, momentum=0.0)

    def tensors(self) -> dict[str, Tensor]:
        """Return the live parameters (K P,) and optimiser state."""
        return {"parameters": self._parameters} | {f"adam.{k}": v for k, v in self._adam.tensors().items()}

    def predict(self, observation: Tensor, pool: Executor) -> Tensor:
        """Return lambda (M, K) at observations (M, O)."""
        outputs = [self._network.outputs(parameters, observation, pool) for parameters in self._networks()]
        return softplus(torch.cat(outputs, dim=1))

    def ascend(self, observation: Tensor, excess: Tensor, pool: Executor) -> None:
        """Take one Adam step up the mean of sum_k lambda_k(s) excess_k, for `excess` (M, K) at observations (M, O).

        Raises NotFiniteError for a gradient that is not finite.
        """
        self._adam.step(-finite(self.gradient(observation, excess, pool), "gradient of the multipliers"))

    def gradient(self, observation: Tensor, excess: Tensor, pool: Executor) -> Tensor:
        """Return the gradient (K P,) of the mean of sum_k lambda_k(s) excess_k."""
        network, share = self._network, excess / len(excess)

        def of(parameters: Tensor, weight: Tensor) -> Tensor:
            def add(rows: Tensor, weight: Tensor, out: Tensor) -> None:
                activations = network.activations(parameters, rows)
                slope = torch.sigmoid(activations[-1]) * weight[:, None]  # softplus' = sigmoid
                network.pull(parameters, activations, slope, out)

            return accumulate(pool, parameters, add, pieces(observation), pieces(weight))

        return torch.cat([of(*column) for column in zip(self._networks(), share.T, strict=True)])

    def _networks(self) -> tuple[Tensor, ...]:
        """Return views (P,) of every network's parameters."""
        return self._parameters.split(self._network.num_parameters)
