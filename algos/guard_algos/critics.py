"""Value functions: what the policy's discounted reward, and each constrained cost, will be from an observation."""

from __future__ import annotations

import torch
from torch import Tensor

from guard_algos.adam import Adam
from guard_algos.finite import finite
from guard_algos.networks import ROWS, Mlp


class Critic:
    """A network V(s) fitted by full-batch Adam to the mean squared error; its optimiser's state lasts over epochs."""

    def __init__(self, network: Mlp, generator: torch.Generator, learning_rate: float) -> None:
        self._network = network
        self._parameters = network.init(generator)
        self._adam = Adam(self._parameters, learning_rate)

    def tensors(self) -> dict[str, Tensor]:
        """Return the live parameters and optimiser state."""
        return {"parameters": self._parameters} | {f"adam.{k}": v for k, v in self._adam.tensors().items()}

    def predict(self, observation: Tensor) -> Tensor:
        """Return V (M,) at observations (M, O)."""
        return torch.cat([self._network.forward(self._parameters, rows)[:, 0] for rows in observation.split(ROWS)])

    def fit(self, observation: Tensor, target: Tensor, iterations: int) -> tuple[float, float]:
        """Take Adam steps towards `target` (M,) at observations (M, O); return the loss before and after.

        Raises NotFiniteError for a loss that is not finite.
        """
        gradient = torch.empty_like(self._parameters)
        before = None
        for _ in range(iterations):
            loss = self._loss(observation, target, gradient)
            before = loss if before is None else before
            self._adam.step(gradient)
        after = finite(self._loss(observation, target, gradient), "loss of a critic")
        return float(after if before is None else before), float(after)

    def _loss(self, observation: Tensor, target: Tensor, gradient: Tensor) -> Tensor:
        """Return the mean squared error, a scalar, and write its gradient (P,) to `gradient`."""
        gradient.zero_()
        loss = torch.zeros((), dtype=torch.float64)
        for rows, goal in zip(observation.split(ROWS), target.split(ROWS), strict=True):
            activations = self._network.activations(self._parameters, rows)
            error = activations[-1][:, 0] - goal
            loss += error.dot(error) / len(target)
            self._network.pull(self._parameters, activations, (2 / len(target)) * error[:, None], out=gradient)
        return loss
