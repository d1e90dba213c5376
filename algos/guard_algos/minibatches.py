"""Which rows of an epoch's batch each step of a fit looks at."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor


def minibatches(size: int, batch_size: int, count: int, seed: int) -> Iterator[Tensor | slice]:
    """Yield `count` selections of `batch_size` of `size` rows, or of all rows where there are no more than that.

    The rows are shuffled anew for each pass over them; those that do not fill a last selection wait for another pass.
    The `seed` decides them, so that a resumed training draws what an uninterrupted one does.
    """
    if batch_size >= size:
        yield from [slice(None)] * count
        return
    generator = torch.Generator().manual_seed(seed)
    per_pass = size // batch_size
    for _ in range(0, count, per_pass):
        shuffled = torch.randperm(size, generator=generator)
        yield from shuffled.split(batch_size)[: min(per_pass, count)]
        count -= per_pass
