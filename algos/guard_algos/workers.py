"""Threads that share the rows of a batch: each takes a piece at a time, and pieces are put together in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

ROWS = 3000
"""Rows of one piece: a layer's activations stay in a processor's cache."""


@contextmanager
def workers(count: int) -> Iterator[Executor]:
    """Give a pool of `count` threads, and one thread to each PyTorch operation while it is open.

    Threads that meet once per sweep over the batch lose less to other processes on the machine than threads that share
    and wait in each operation. No result depends on `count`, because a piece is always computed by one thread.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(count, initializer=torch.set_num_threads, initargs=(1,)) as pool:
            yield pool
    finally:
        torch.set_num_threads(before)


def pieces(batch: Tensor) -> tuple[Tensor, ...]:
    """Return views of the rows of `batch` (M, ...)."""
    return batch.split(ROWS)


def accumulate(pool: Executor, like: Tensor, add: Callable[..., None], *columns: Sequence[Any]) -> Tensor:
    """Return the sum (P,) of what `add(*items, out)` adds to `out` (P,), `like` (P,), for the items of each piece."""
    parts = like.new_zeros(len(columns[0]), len(like))
    for _ in pool.map(add, *columns, parts):
        pass
    return parts.sum(0)
