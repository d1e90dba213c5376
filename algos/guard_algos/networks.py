"""Multilayer perceptrons on one flat parameter vector, with their Jacobian products written out.

The critics' fits and the Fisher products are most of a training's time. Both need only products with the network's
Jacobian, which are three sweeps over the layers; written out, a critic's gradient takes two thirds of the time of
automatic differentiation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

ROWS = 3000
"""Rows of one piece of a batch: a layer's activations stay in a processor's cache."""


@dataclass(frozen=True, slots=True)
class Mlp:
    """Tanh layers and a linear output: `sizes` are the widths of input, hidden layers and output.

    Parameters are one vector (P,): weight (out, in) and bias (out,) of each layer in turn.
    """

    sizes: tuple[int, ...]

    @property
    def num_parameters(self) -> int:
        """Length P of the parameter vector."""
        return sum(a * b + b for a, b in pairwise(self.sizes))

    def init(self, generator: torch.Generator) -> Tensor:
        """Return initial parameters (P,), uniform in +-1/sqrt(inputs of the layer), as GUARD's networks are."""
        scale = torch.cat([torch.full((a * b + b,), 1 / math.sqrt(a)) for a, b in pairwise(self.sizes)])
        return (2 * torch.rand(self.num_parameters, generator=generator) - 1) * scale

    def layers(self, parameters: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Return views of `parameters` (P,): weight (out, in) and bias (out,) of each layer."""
        views, start = [], 0
        for a, b in pairwise(self.sizes):
            middle, end = start + a * b, start + a * b + b
            views.append((parameters[start:middle].view(b, a), parameters[middle:end]))
            start = end
        return views

    def forward(self, parameters: Tensor, x: Tensor) -> Tensor:
        """Return the outputs (M, out) at the inputs x (M, in)."""
        return self.activations(parameters, x)[-1]

    def outputs(self, parameters: Tensor, x: Tensor, pool: Executor) -> Tensor:
        """Return `forward` of a large batch x (M, in), by the threads of `pool`."""
        return torch.cat(list(pool.map(lambda rows: self.forward(parameters, rows), pieces(x))))

    def activations(self, parameters: Tensor, x: Tensor) -> list[Tensor]:
        """Return the input (M, in), every tanh layer's output and the output (M, out): what the products below need."""
        *hidden, (weight, bias) = self.layers(parameters)
        values = [x]
        for w, b in hidden:
            values.append(torch.tanh(torch.addmm(b, values[-1], w.T)))
        values.append(torch.addmm(bias, values[-1], weight.T))
        return values

    def push(self, parameters: Tensor, activations: list[Tensor], direction: Tensor) -> Tensor:
        """Return J d (M, out): how the outputs move when the parameters move along `direction` d (P,)."""
        moves = zip(self.layers(parameters), self.layers(direction), strict=True)
        tangent: Tensor | None = None
        for i, ((weight, _), (weight_move, bias_move)) in enumerate(moves):
            change = torch.addmm(bias_move, activations[i], weight_move.T)
            if tangent is not None:
                change.addmm_(_through_tanh(tangent, activations[i]), weight.T)
            tangent = change
        assert tangent is not None
        return tangent

    def pull(self, parameters: Tensor, activations: list[Tensor], cotangent: Tensor, out: Tensor) -> None:
        """Add J^T y (P,) to `out`: the gradient of sum(y * outputs), for `cotangent` y (M, out)."""
        layers, gradients = self.layers(parameters), self.layers(out)
        for i in reversed(range(len(layers))):
            weight, (weight_gradient, bias_gradient) = layers[i][0], gradients[i]
            weight_gradient.addmm_(cotangent.T, activations[i])
            bias_gradient.add_(cotangent.sum(0))
            if i > 0:
                cotangent = _through_tanh(cotangent @ weight, activations[i])

    def input_gradient(self, parameters: Tensor, activations: list[Tensor], cotangent: Tensor) -> Tensor:
        """Return the gradient (M, in) of sum(y * outputs) by the inputs, for `cotangent` y (M, out)."""
        layers = self.layers(parameters)
        for i in reversed(range(1, len(layers))):
            cotangent = _through_tanh(cotangent @ layers[i][0], activations[i])
        return cotangent @ layers[0][0]


def _through_tanh(slope: Tensor, output: Tensor) -> Tensor:
    """Return slope * tanh' where `output` is the tanh layer's value: the same factor in both directions."""
    return torch.ops.aten.tanh_backward(slope, output)


def pieces(batch: Tensor) -> tuple[Tensor, ...]:
    """Return views of the rows of `batch` (M, ...): what one thread takes at a time."""
    return batch.split(ROWS)


def accumulate(pool: Executor, like: Tensor, add: Callable[..., None], *columns: Sequence[Any]) -> Tensor:
    """Return the sum (P,) of what `add(*items, out)` adds to `out` (P,), `like` (P,), for the items of each piece."""
    parts = like.new_zeros(len(columns[0]), len(like))
    for _ in pool.map(add, *columns, parts):
        pass
    return parts.sum(0)
