"""Projection onto a half-space within the box of actions, in closed form."""

from __future__ import annotations

import torch
from torch import Tensor


def project(action: Tensor, normal: Tensor, excess: Tensor) -> Tensor:
    """Return the points of [-1, 1]^A nearest to `action` (N, A) at which normal . a is lower by `excess` (N,).

    normal: (N, A). action lies in the box. Where the box has no such point, it is the one at which normal . a is least;
    components that cannot change it stay. The Lagrangian of min |x - a|^2 / 2 is separable, x(m) = clip(a - m normal),
    and normal . x(m) falls linearly in the multiplier m, in pieces that end where a component meets its bound.
    """
    reach = torch.where(normal != 0, (1 + torch.sign(normal) * action) / normal.abs(), 0.0)  # m at which it does
    reach, order = reach.sort(dim=-1)
    slope = normal.square().gather(-1, order)
    fallen = (slope * reach).cumsum(-1)  # by the components that have met their bounds
    remaining = slope.flip(-1).cumsum(-1).flip(-1) - slope  # slope of the others
    piece = (fallen + remaining * reach < excess[:, None]).sum(-1, keepdim=True).clamp(max=action.shape[-1] - 1)
    before, slope_there = (fallen - slope * reach).gather(-1, piece), (remaining + slope).gather(-1, piece)
    multiplier = (excess[:, None] - before) / slope_there.clamp(min=torch.finfo(action.dtype).tiny)
    multiplier = torch.minimum(multiplier, reach.gather(-1, piece)).clamp(min=0.0)
    return (action - multiplier * normal).clamp(-1.0, 1.0)
