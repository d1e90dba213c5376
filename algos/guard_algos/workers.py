"""The threads that share the rows of a batch."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager

import torch


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
