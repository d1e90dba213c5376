"""Adam on one flat parameter vector, with its state in plain tensors so that a checkpoint holds all of it."""

from __future__ import annotations

import torch
from torch import Tensor

_BETA_2, _EPSILON = 0.999, 1e-8


class Adam:
    """The optimiser of `parameters` (P,), which it moves in place. Source: Kingma and Ba 2015, algorithm 1.

    momentum: the decay of the first moment, beta_1; 0 follows each gradient as it comes.
    """

    def __init__(self, parameters: Tensor, learning_rate: float, momentum: float = 0.9) -> None:
        self._parameters, self._learning_rate, self._momentum = parameters, learning_rate, momentum
        self._mean, self._square = torch.zeros_like(parameters), torch.zeros_like(parameters)
        self._count = torch.zeros(1, dtype=torch.int64)

    def tensors(self) -> dict[str, Tensor]:
        """Return the live state: the moments (P,) and the number of steps (1,)."""
        return {"mean": self._mean, "square": self._square, "count": self._count}

    @property
    def count(self) -> int:
        """Number of steps taken so far."""
        return int(self._count)

    def step(self, gradient: Tensor) -> None:
        """Move the parameters against `gradient` (P,)."""
        self._count += 1
        count = self.count
        self._mean.lerp_(gradient, 1 - self._momentum)
        self._square.mul_(_BETA_2).addcmul_(gradient, gradient, value=1 - _BETA_2)
        scale = (self._square / (1 - _BETA_2**count)).sqrt_().add_(_EPSILON)
        self._parameters.addcdiv_(self._mean, scale, value=-self._learning_rate / (1 - self._momentum**count))
