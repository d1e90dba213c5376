"""Training the policies of a transfer experiment, each in its own run directory, resumable at any moment."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import shutil
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, TypeAlias

from guard_api import plugins
from guard_api.algorithm import TrainingJob
from guard_api.env import make_environment
from guard_api.errors import RunError
from guard_api.measure.plan import TransferPlan
from guard_api.physics.build import usable_cores
from guard_api.runs.atomic import write_json
from guard_api.runs.directory import RunDirectory
from guard_api.runs.manifest import build_manifest

Report: TypeAlias = Callable[[str, int, Mapping[str, float]], None]
"""Called with backend, seed and the metrics row after every epoch."""

FINISHED: Final = "finished.json"
"""Marks a run directory whose training reached its steps; names the checkpoint of the final policy."""


def run_path(out: Path, backend: str, seed: int) -> Path:
    """Return where the training of `seed` in `backend` lives."""
    return out / "train" / backend / f"seed{seed}"


def is_trained(out: Path, backend: str, seed: int) -> bool:
    """Return whether that training is finished."""
    return (run_path(out, backend, seed) / FINISHED).exists()


def train(
    plan: TransferPlan,
    out: Path,
    backend: str,
    seed: int,
    report: Report,
    should_stop: Callable[[], bool],
    workers: int | None = None,
) -> bool:
    """Train one policy, going on from its last checkpoint if there is one; return whether it is finished."""
    path = run_path(out, backend, seed)
    if is_trained(out, backend, seed):
        return True
    algorithm = plugins.load("guard.algorithms", plan.algorithm)
    env = make_environment(plan.spec, backend=backend, num_worlds=plan.num_worlds, seed=seed, workers=workers)
    try:
        run, resume = _run_directory(plan, path, backend, seed)
        with contextlib.closing(run):
            job = TrainingJob(
                env=env,
                run=run,
                config=plan.config,
                total_steps=plan.total_steps,
                seed=seed,
                resume=resume,
                report=lambda row: report(backend, seed, row),
                should_stop=should_stop,
            )
            if not algorithm.train(job):
                return False
            last = run.last_checkpoint()
    finally:
        env.close()
    if last is None:
        raise RunError(f"{path}: {plan.algorithm} finished without leaving a checkpoint: its plugin is at fault")
    write_json(path / FINISHED, {"checkpoint": last.name})
    return True


def _run_directory(plan: TransferPlan, path: Path, backend: str, seed: int) -> tuple[RunDirectory, bool]:
    """Return the run directory and whether it can be resumed; one without a checkpoint holds nothing to keep."""
    if path.exists():
        run = RunDirectory.open(path)
        if run.last_checkpoint() is not None:
            return run, True
        shutil.rmtree(path)
    manifest = build_manifest(
        env_spec=plan.spec,
        backend=plugins.load("guard.backends", backend),
        algorithm=plan.algorithm,
        seed=seed,
        num_worlds=plan.num_worlds,
        total_steps=plan.total_steps,
    )
    return RunDirectory.create(path, manifest=manifest, config=asdict(plan.config)), False


def train_all(
    plan: TransferPlan,
    out: Path,
    report: Report,
    should_stop: Callable[[], bool],
    jobs: int = 1,
    workers: int | None = None,
) -> bool:
    """Train every missing policy, `jobs` at a time in processes of their own; return whether all are finished."""
    missing = [(b, s) for b in plan.sources for s in plan.seeds if not is_trained(out, b, s)]
    if jobs > 1 and len(missing) > 1:
        return _train_in_processes(plan, out, missing, report, should_stop, jobs, workers)
    return all(train(plan, out, backend, seed, report, should_stop, workers) for backend, seed in missing)


def _train_in_processes(
    plan: TransferPlan,
    out: Path,
    missing: list[tuple[str, int]],
    report: Report,
    should_stop: Callable[[], bool],
    jobs: int,
    workers: int | None,
) -> bool:
    context = multiprocessing.get_context("spawn")
    stop, rows = context.Event(), context.Queue()
    threads = max(1, usable_cores() // jobs)
    with (
        _numeric_threads(threads),
        ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin_process, initargs=(stop, rows)) as pool,
    ):
        futures = [pool.submit(_train_here, plan, out, b, s, workers or threads) for b, s in missing]
        try:
            _supervise(futures, stop, rows, report, should_stop)
            return all(future.result() for future in futures)
        except BrokenProcessPool as error:
            raise RunError(f"{out}: a training process died: run the same command again to go on") from error
        finally:
            stop.set()  # an error or Ctrl-C here lets the others leave a checkpoint before the pool closes
            for future in futures:
                future.cancel()


def _supervise(
    futures: list[Future[bool]], stop: Any, rows: Any, report: Report, should_stop: Callable[[], bool]
) -> None:
    """Pass on the processes' rows until all are done or one failed; tell them when to stop."""
    pending = set(futures)
    while pending:
        done, pending = wait(pending, timeout=0.2, return_when=FIRST_EXCEPTION)
        _pass_on(rows, report)
        if should_stop():
            stop.set()
        for future in done:
            future.result()
    _pass_on(rows, report)


def _pass_on(rows: Any, report: Report) -> None:
    with contextlib.suppress(queue.Empty):
        while True:
            report(*rows.get_nowait())


_process: dict[str, Any] = {}
"""In a training process: the parent's stop event and the queue of rows."""


def _begin_process(stop: Any, rows: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends Ctrl-C to all; the parent decides
    _process.update(stop=stop, rows=rows)


def _train_here(plan: TransferPlan, out: Path, backend: str, seed: int, workers: int) -> bool:
    if _process["stop"].is_set():
        return False
    rows = _process["rows"]
    return train(plan, out, backend, seed, lambda *row: rows.put(row), _process["stop"].is_set, workers)


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
