"""Value functions: what the policy's discounted reward, and each constrained cost, will be from an observation."""

from __future__ import annotations

from concurrent.futures import Executor

import torch
from torch import Tensor

from guard_algos.adam import Adam
from guard_algos.finite import finite
from guard_algos.minibatches import minibatches
from guard_algos.networks import Mlp, accumulate, pieces


class Critic:
    """A network V(s) fitted by Adam to the mean squared error; its optimiser's state lasts over epochs."""

    def __init__(self, network: Mlp, generator: torch.Generator, learning_rate: float) -> None:
        self._network = network
        self._parameters = network.init(generator)
        self._adam = Adam(self._parameters, learning_rate)

    def tensors(self) -> dict[str, Tensor]:
        """Return the live parameters and optimiser state."""
        return {"parameters": self._parameters} | {f"adam.{k}": v for k, v in self._adam.tensors().items()}

    def predict(self, observation: Tensor, pool: Executor) -> Tensor:
        """Return V (M,) at observations (M, O)."""
        return self._network.outputs(self._parameters, observation, pool)[:, 0]

    def fit(
        self, observation: Tensor, target: Tensor, iterations: int, batch_size: int, pool: Executor
    ) -> tuple[float, float]:
        """Take Adam steps towards `target` (M,) at observations (M, O); return the loss of all rows before and after.

        Each step looks at `batch_size` rows. Raises NotFiniteError for a loss that is not finite.
        """
        before = self._loss(observation, target, pool)
        for rows in minibatches(len(target), batch_size, iterations, seed=self._adam.count):
            self._adam.step(self._gradient(observation[rows], target[rows], pool))
        after = self._loss(observation, target, pool)
        return float(before), float(finite(after, "loss of a critic"))

    def _loss(self, observation: Tensor, target: Tensor, pool: Executor) -> Tensor:
        return (self.predict(observation, pool) - target).double().square().mean()

    def _gradient(self, observation: Tensor, target: Tensor, pool: Executor) -> Tensor:
        """Return the gradient (P,) of the mean squared error."""
        network, parameters = self._network, self._parameters

        def add(rows: Tensor, goal: Tensor, out: Tensor) -> None:
            activations = network.activations(parameters, rows)
            error = activations[-1] - goal[:, None]
            network.pull(parameters, activations, (2 / len(target)) * error, out)

        return accumulate(pool, parameters, add, pieces(observation), pieces(target))
