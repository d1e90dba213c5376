"""The check that stops a training at the first number that is not finite."""

from __future__ import annotations

import torch
from torch import Tensor

from guard_api.errors import GuardError


class NotFiniteError(GuardError):
    """An observation, loss, gradient or step that holds NaN or infinity."""


def finite(values: Tensor, quantity: str) -> Tensor:
    """Return `values`; raises NotFiniteError naming the `quantity` where one of them is NaN or infinite."""
    if not bool(torch.isfinite(values).all()):
        raise NotFiniteError(f"{quantity} is not finite")
    return values
