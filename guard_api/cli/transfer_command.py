"""`guard transfer`: train on some backends, evaluate on all, and write the transfer matrix with its report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import tyro
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as ProgressBars

from guard_api.cli.interrupt import stop_request
from guard_api.cli.options import parse_with_algorithm, whole_steps
from guard_api.cli.output import print_json, print_line, print_table
from guard_api.errors import SpecError
from guard_api.measure.diagnosis import Finding
from guard_api.measure.plan import TransferPlan
from guard_api.measure.report import write_report
from guard_api.measure.training import Training
from guard_api.measure.transfer import Progress, run_transfer
from guard_api.runs.atomic import read_json
from guard_api.suite import make_spec

Config = TypeVar("Config")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(Generic[Config]):
    """The experiment; the algorithm's own options follow. The same command continues after an interruption."""

    env: str
    """Environment, such as Goal_Point_8Hazards (`guard list envs`), or a TOML file that specifies one."""
    out: Path
    """Directory for everything: runs, cells, transfer.json, matrix.png, report.html."""
    algo: str = "cpo"
    """Algorithm (`guard list algos`)."""
    backends: tuple[str, ...] = ("mujoco", "bullet", "sapien")
    """Simulators to evaluate every policy in."""
    train_on: tuple[str, ...] = ()
    """Simulators to train in; all of --backends when left out."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds; below 3 there is no interval."""
    total_steps: float = 1e6
    """Environment steps of each training."""
    num_worlds: int = 30
    """Worlds stepped together in training."""
    episodes: int = 100
    """Evaluation episodes of each policy in each simulator."""
    verdict_limit: float | None = None
    """Limit of the summed episode cost for the safe/unsafe verdicts; the algorithm's limit when left out."""
    jobs: int = 1
    """Trainings at a time."""
    workers: int | None = None
    """Threads or processes that step the worlds; chosen by GUARD when left out. Changes no number."""
    json: bool = False
    """Print the matrix as JSON."""
    algorithm: Annotated[Config, tyro.conf.arg(name="")]
    """Options of the algorithm."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    text = "Train on some simulators, evaluate every policy in all: the transfer matrix."
    options, algorithm = parse_with_algorithm(Options, "transfer", argv, text)
    if options.jobs < 1:
        raise SpecError(f"--jobs is {options.jobs}: it must be at least 1")
    plan = TransferPlan(
        spec=make_spec(options.env),
        algorithm=algorithm.name,
        config=options.algorithm,
        backends=options.backends,
        train_on=options.train_on,
        seeds=options.seeds,
        total_steps=whole_steps(options.total_steps),
        num_worlds=options.num_worlds,
        episodes=options.episodes,
        cost_limit=options.verdict_limit,
    )
    result = _run(plan, options)
    if result is None:
        raise KeyboardInterrupt
    report = write_report(options.out)
    matrix = read_json(result, "run the same command again")
    if options.json:
        cells = [{key: value for key, value in cell.items() if key != "runs"} for cell in matrix["cells"]]
        print_json({"report": str(report), "cells": cells, "transfers": matrix["transfers"]})
    else:
        _print_matrix(matrix)
        print(f"report: {report}")
    return 0


def _run(plan: TransferPlan, options: Any) -> Path | None:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[now]}"))
    with stop_request() as stop, ProgressBars(*columns, TimeElapsedColumn(), disable=options.json) as bars:
        tasks = {
            stage: bars.add_task(text, total=None, now="")
            for stage, text in (("train", "train policies"), ("evaluate", "evaluate cells"))
        }

        def report(progress: Progress) -> None:
            now = f"{progress.source} seed {progress.seed}"
            if progress.row is not None:
                row = progress.row
                now += f": {row['total_steps']:,.0f}/{plan.total_steps:,} steps, return {row['return_mean']:.1f}"
                now += f", cost {row['cost_mean']:.1f}, {row['steps_per_second']:,.0f}/s"
            else:
                now += f" in {progress.target}"
            bars.update(tasks[progress.stage], completed=progress.done, total=progress.total, now=now)

        def warned(training: Training, finding: Finding) -> None:
            print_line(f"{training.backend} seed {training.seed} warning: {finding}", bars.console, options.json)

        size = {"jobs": options.jobs, "workers": options.workers}
        return run_transfer(plan, options.out, **size, report=report, warned=warned, should_stop=stop)


def _print_matrix(result: dict[str, Any]) -> None:
    rows = []
    for cell in result["cells"]:
        numbers = [_estimate(cell["estimates"][name]) for name in ("return", "cost", "violation", "success")]
        rows.append([cell["source"], cell["target"], *numbers, (cell["verdict"] or "").strip()])
    title = f"{result['manifest']['env']}, {result['manifest']['algorithm']}, {len(result['seeds'])} seeds"
    print_table(title, ("trained in", "run in", "return", "cost", "violation", "success", "verdict"), rows)


def _estimate(estimate: dict[str, Any]) -> str:
    low, high = estimate.get("low"), estimate.get("high")
    interval = "" if low is None else f" [{low:.3g}, {high:.3g}]"
    value = estimate["value"]
    return "undefined" if value is None else f"{value:.3g}{interval}"
