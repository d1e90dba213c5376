"""Conjugate gradient for a symmetric positive definite matrix that is only known by its products."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, slots=True)
class Solution:
    """`x` (P,), the relative `residual` |A x - b| / |b| that the recursion reports, and the `iterations` taken."""

    x: Tensor
    residual: float
    iterations: int


def solve(product: Callable[[Tensor], Tensor], b: Tensor, *, iterations: int, tolerance: float) -> Solution:
    """Return an approximate solution of A x = b (P,) by at most `iterations` products x -> A x.

    Stops at a relative residual of `tolerance`. b = 0 gives x = 0. Source: Nocedal and Wright 2006, algorithm 5.2.
    """
    x, r, p = torch.zeros_like(b), b.clone(), b.clone()
    rr = start = float(r.dot(r))
    count = 0
    while count < iterations and rr > tolerance**2 * start:
        product_p = product(p)
        alpha = rr / float(p.dot(product_p))
        x.add_(p, alpha=alpha)
        r.sub_(product_p, alpha=alpha)
        rr, previous = float(r.dot(r)), rr
        p.mul_(rr / previous).add_(r)
        count += 1
    return Solution(x, (rr / start) ** 0.5 if start > 0 else 0.0, count)
