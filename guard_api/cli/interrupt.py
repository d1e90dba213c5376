"""Ctrl-C and SIGTERM: the first asks a long job to stop at its next safe point, the second stops it at once."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """Whether the user asked to stop; call it to find out."""

    def __init__(self) -> None:
        self.requested = False

    def __call__(self) -> bool:
        """Return whether a stop was asked for."""
        return self.requested

    def handle(self, signum: int, frame: FrameType | None) -> None:
        """Note the first signal; let the second end the program."""
        del frame
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
        name = signal.Signals(signum).name
        print(f"\n{name}: leaving a checkpoint after this epoch; once more stops at once", file=sys.stderr)


@contextmanager
def stop_request() -> Iterator[StopRequest]:
    """Catch SIGINT and SIGTERM inside the block; restores the former handlers after it."""
    stop = StopRequest()
    former = {number: signal.signal(number, stop.handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
