"""`guard suite`: train a grid of environments, algorithms, simulators and seeds, some at a time, resumable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from guard_api.cli.interrupt import stop_request
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_line, print_table
from guard_api.errors import SpecError
from guard_api.measure.diagnosis import Finding
from guard_api.measure.grid import parse_options, read_grid
from guard_api.measure.pool import train_all
from guard_api.measure.training import Training, findings, is_trained
from guard_api.runs.progress import read_rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The grid, from a file or from flags, which win. The same command goes on after an interruption."""

    out: Path
    """Folder of the run directories, each called {env}_{algo}_{backend}_seed{k}; those that `guard train` made there
    are taken up."""
    grid: Path | None = None
    """TOML file with the keys envs, algos, backends, seeds, total_steps, num_worlds, preset and [options]."""
    envs: tuple[str, ...] = ()
    """Environments (`guard list envs`)."""
    algos: tuple[str, ...] = ()
    """Algorithms (`guard list algos`)."""
    backends: tuple[str, ...] = ()
    """Simulators; mujoco when left out."""
    seeds: tuple[int, ...] = ()
    """Training seeds; 0 when left out."""
    total_steps: float | None = None
    """Environment steps of each training; the preset's, or a million, when left out."""
    num_worlds: int | None = None
    """Worlds stepped together; the preset's, or 30, when left out."""
    preset: str = ""
    """Settings to start from: paper, those of GUARD's paper."""
    options: tuple[str, ...] = ()
    """Options of the algorithms: name=value for all that have it, algo.name=value for one, such as
    threads=1 cpo.cost_limit=2."""
    jobs: int = 1
    """Trainings at a time. With two or more, each has a process of its own, and a crash ends only that one."""
    workers: int | None = None
    """Threads or processes that step the worlds of one training; chosen by GUARD when left out."""
    json: bool = False
    """Print JSON instead of a table."""


_GRID = ("envs", "algos", "backends", "seeds", "total_steps", "num_worlds", "preset")


def main(argv: Sequence[str]) -> int:
    """Run the command; returns 1 when a training failed."""
    options = parse(Options, "suite", argv, "Train a grid of environments, algorithms, simulators and seeds.")
    if options.jobs < 1:
        raise SpecError(f"--jobs is {options.jobs}: it must be at least 1")
    given = {name: getattr(options, name) for name in _GRID if getattr(options, name) not in ((), None, "")}
    if options.options:
        given["options"] = parse_options(options.options)
    trainings = read_grid(options.grid, given).trainings(options.out)
    failures: dict[Path, str] = {}
    stopped = _train(trainings, options, failures)
    _print(trainings, failures, options)
    if stopped:
        raise KeyboardInterrupt
    return 1 if failures else 0


def _train(trainings: Sequence[Training], options: Options, failures: dict[Path, str]) -> bool:
    """Train what is missing, saying what goes wrong; return whether the user stopped it.

    failures: run -> reason, filled in.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[now]}"))
    with stop_request() as stop, Progress(*columns, TimeElapsedColumn(), disable=options.json) as progress:
        bar = progress.add_task("trainings", total=len(trainings), now="")
        finished = {training.path for training in trainings if is_trained(training)}
        progress.update(bar, completed=len(finished))

        def report(training: Training, row: Mapping[str, float]) -> None:
            if row["total_steps"] >= training.total_steps:
                finished.add(training.path)
            now = f"{training.path.name}: {row['total_steps']:,.0f}/{training.total_steps:,} steps, "
            now += f"return {row['return_mean']:.1f}, cost {row['cost_mean']:.1f}"
            progress.update(bar, completed=len(finished), now=now)

        def say(line: str) -> None:
            print_line(line, progress.console, options.json)

        def warned(training: Training, finding: Finding) -> None:
            say(f"{training.path.name} warning: {finding}")

        def failed(training: Training, error: Exception) -> None:
            failures[training.path] = f"{error}" or type(error).__name__
            say(f"{training.path.name} failed: {failures[training.path]}")

        size = {"jobs": options.jobs, "workers": options.workers}
        return not train_all(trainings, report, stop, **size, warned=warned, failed=failed) and stop()


def _print(trainings: Sequence[Training], failures: Mapping[Path, str], options: Options) -> None:
    rows = [_state(training, failures) for training in trainings]
    if options.json:
        print_json({"out": str(options.out), "runs": rows})
        return
    columns = ("run", "state", "steps", "return", "cost")
    print_table(str(options.out), columns, [[row[column] for column in columns] for row in rows])
    for training, row in zip(trainings, rows, strict=True):
        for finding in findings(training):
            print(f"warning: {row['run']}: {finding}")
        if row["error"]:
            print(f"failed: {row['run']}: {row['error']}")


def _state(training: Training, failures: Mapping[Path, str]) -> dict[str, Any]:
    """Return what a run has come to."""
    error = failures.get(training.path, "")
    state = "failed" if error else "finished" if is_trained(training) else "unfinished"
    rows = read_rows(training.path / "progress.csv")
    last = rows[-1] if rows else {}
    numbers = [last.get(name, float("nan")) for name in ("total_steps", "return_mean", "cost_mean")]
    steps, gained, cost = numbers
    return {
        "run": training.path.name,
        "state": state,
        "steps": int(steps) if rows else 0,
        "return": gained,
        "cost": cost,
        "warnings": [asdict(finding) for finding in findings(training)],
        "error": error,
    }
