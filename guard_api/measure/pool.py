"""A pool of trainings on this machine: several at a time, each in a process of its own."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any, Final, TypeAlias

from guard_api.errors import RunError
from guard_api.measure.diagnosis import Finding
from guard_api.measure.training import Training, is_trained, train
from guard_api.physics.build import usable_cores

Report: TypeAlias = Callable[[Training, Mapping[str, float]], None]
"""Called with a training and its metrics row after every epoch."""

Warned: TypeAlias = Callable[[Training, Finding], None]
"""Called with a training and what begins to go wrong in it."""

Failed: TypeAlias = Callable[[Training, Exception], None]
"""Called with a training that ended in an error, and the error."""

_POLL: Final = 0.2
"""How often processes are looked after [s]."""


def train_all(
    trainings: Sequence[Training],
    report: Report,
    should_stop: Callable[[], bool],
    *,
    jobs: int = 1,
    workers: int | None = None,
    warned: Warned = lambda training, finding: None,
    failed: Failed | None = None,
) -> bool:
    """Train what is not finished, `jobs` at a time; return whether all are finished.

    With more than one job every training has a process of its own, so that whatever happens to it ends it alone.
    warned: learns of what goes wrong in a training (`diagnosis`), once when it begins.
    failed: learns of a training that fails, while the others go on; without it the first failure lets the others leave
    a checkpoint, and is raised.
    """
    missing = [training for training in trainings if not is_trained(training)]
    if jobs > 1 and len(missing) > 1:
        return _Pool(report, should_stop, warned, failed, min(jobs, len(missing)), workers).train(missing)
    return _train_in_turn(missing, report, should_stop, workers, warned, failed)


def _train_in_turn(
    missing: Sequence[Training],
    report: Report,
    should_stop: Callable[[], bool],
    workers: int | None,
    warned: Warned,
    failed: Failed | None,
) -> bool:
    finished = True
    for training in missing:
        try:
            hear, listen = partial(report, training), partial(warned, training)
            if not train(training, hear, should_stop, workers, listen):
                return False
        except Exception as error:
            if failed is None:
                raise
            failed(training, error)
            finished = False
        if should_stop() and training is not missing[-1]:
            return False
    return finished


class _Pool:
    """Threads that each look after one training process at a time; all they learn reaches the caller's thread."""

    def __init__(
        self,
        report: Report,
        should_stop: Callable[[], bool],
        warned: Warned,
        failed: Failed | None,
        jobs: int,
        workers: int | None,
    ) -> None:
        self._report, self._should_stop, self._warned, self._failed = report, should_stop, warned, failed
        self._jobs, self._threads = jobs, max(1, usable_cores() // jobs)
        self._workers = workers or self._threads
        self._context = multiprocessing.get_context("spawn")
        self._stop = self._context.Event()
        self._news: queue.SimpleQueue[tuple[Training, Finding | Mapping[str, float]]] = queue.SimpleQueue()

    def train(self, missing: Sequence[Training]) -> bool:
        """Train them; return whether all are finished."""
        with _numeric_threads(self._threads), ThreadPoolExecutor(self._jobs) as threads:
            futures = {threads.submit(self._train_in_process, training): training for training in missing}
            try:
                failures = self._supervise(futures)
            finally:
                self._stop.set()  # an error or Ctrl-C here lets the others leave a checkpoint before the pool closes
                for future in futures:
                    future.cancel()
        return not failures and all(future.result() for future in futures)

    def _supervise(self, futures: Mapping[Future[bool], Training]) -> int:
        """Pass on what the processes say until all are done; return how many failed."""
        pending, failures = set(futures), 0
        while pending:
            done, pending = wait(pending, timeout=_POLL, return_when=FIRST_COMPLETED)
            self._pass_on()
            if self._should_stop():
                self._stop.set()
            for future in done:
                error = future.exception()
                if error is None:
                    continue
                if self._failed is None or not isinstance(error, Exception):
                    raise error
                self._failed(futures[future], error)
                failures += 1
        self._pass_on()
        return failures

    def _pass_on(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                training, news = self._news.get_nowait()
                if isinstance(news, Finding):
                    self._warned(training, news)
                else:
                    self._report(training, news)

    def _train_in_process(self, training: Training) -> bool:
        """Train in a new process and forward its news. Raises RunError when the process dies."""
        if self._stop.is_set():
            return False
        news = self._context.Queue()
        arguments = (self._stop, news)
        with ProcessPoolExecutor(1, self._context, initializer=_begin_process, initargs=arguments) as process:
            future = process.submit(_train_here, training, self._workers)
            while True:
                try:
                    self._news.put((training, news.get(timeout=_POLL)))
                except queue.Empty:
                    if future.done():
                        break
        again = "run the same command again to go on"
        try:
            finished = future.result()
        except BrokenProcessPool as error:
            raise RunError(f"{training.path}: its training process died: {again}") from error
        if not finished and not self._stop.is_set():
            raise RunError(f"{training.path}: its training process was told to end, and left a checkpoint: {again}")
        return finished


_process: dict[str, Any] = {}
"""In a training process: the parent's stop event, the queue of metrics rows and findings, and whether it was told to
end by itself."""


def _begin_process(stop: Any, news: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends Ctrl-C to all; the parent decides
    # What ends all processes of a service or a batch job: not the parent's event, whose lock this code may hold.
    signal.signal(signal.SIGTERM, lambda number, frame: _process.update(ending=True))
    _process.update(stop=stop, news=news, ending=False)


def _train_here(training: Training, workers: int) -> bool:
    tell = _process["news"].put
    return train(training, tell, lambda: _process["ending"] or _process["stop"].is_set(), workers, tell)


@contextlib.contextmanager
def _numeric_threads(count: int) -> Iterator[None]:
    """Let processes started here use `count` threads for linear algebra, so that they do not fight for the cores."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update({name: value or str(count) for name, value in before.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
