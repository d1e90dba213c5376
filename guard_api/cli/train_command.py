"""`guard train`: train a policy on one backend, into a run directory that can be resumed."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import tyro
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from guard_api.algorithm import Algorithm, find_preset, whole_episodes
from guard_api.cli.interrupt import stop_request
from guard_api.cli.options import last_value, parse_with_algorithm, whole_steps
from guard_api.cli.output import print_json, print_line, print_table
from guard_api.errors import RunError
from guard_api.measure.diagnosis import Finding
from guard_api.measure.training import Training, is_trained, train
from guard_api.runs.directory import RunDirectory
from guard_api.spec import EnvSpec
from guard_api.suite import make_spec

Config = TypeVar("Config")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(Generic[Config]):
    """What to train, where and for how long; the algorithm's own options follow."""

    env: str
    """Environment, such as Goal_Point_8Hazards (`guard list envs`), or a TOML file that specifies one. Not needed to
    --resume."""
    out: Path
    """Run directory to make, or to continue with --resume."""
    algo: str = "trpo"
    """Algorithm (`guard list algos`)."""
    backend: str = "mujoco"
    """Simulator (`guard list backends`)."""
    seed: int = 0
    """Seed of networks, action sampling and layouts."""
    total_steps: float = 1e6
    """Environment steps over all worlds; 1e6 may be written so. Rounded up to whole epochs."""
    num_worlds: int = 30
    """Worlds stepped together. The paper's epoch is 30 worlds x 1000 steps."""
    workers: int | None = None
    """Threads or processes that step the worlds; chosen by GUARD when left out. Changes no number."""
    preset: str = ""
    """Settings to start from: paper, those of GUARD's paper. What is given explicitly wins over them."""
    resume: bool = False
    """Continue from the last checkpoint in --out, to the same bits as without the interruption. Without --env, with the
    options that the run was started with, but for those that are given."""
    json: bool = False
    """Print the last epoch's metrics as JSON."""
    algorithm: Annotated[Config, tyro.conf.arg(name="")]
    """Options of the algorithm."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    resumed = _resumed(argv)
    options, algorithm = parse_with_algorithm(
        Options, "train", argv, "Train a policy on one backend.", _recorded(resumed) if resumed else None
    )
    training = Training(
        path=options.out,
        spec=EnvSpec.from_json(resumed.fact("spec")) if resumed else make_spec(options.env),
        backend=options.backend,
        algorithm=algorithm.name,
        config=options.algorithm,
        seed=options.seed,
        total_steps=whole_steps(options.total_steps),
        num_worlds=options.num_worlds,
        preset=_preset(options, algorithm),
    )
    _check_folder(options.out, options.resume)
    words = sys.stderr if options.json else sys.stdout  # the output is JSON
    before = is_trained(training)
    epoch = _epoch_steps(training)
    steps = math.ceil(training.total_steps / epoch) * epoch if epoch else training.total_steps
    if not before:
        print(*_rounded(training, epoch, steps), sep="", end="", file=words)
    finished = _train(training, options.workers, steps, quiet=options.json)
    run = RunDirectory.open(options.out)
    if before:
        print(f"{options.out}: already trained for {run.rows()[-1]['total_steps']:,.0f} steps", file=words)
    _print_summary(run, options.json)
    if not finished:
        raise KeyboardInterrupt
    return 0


def _resumed(argv: Sequence[str]) -> RunDirectory | None:
    """Return the run that `argv` resumes without an environment, hence with its own options."""
    out = last_value(argv, "--out", "")
    return RunDirectory.open(Path(out)) if "--resume" in argv and out and not last_value(argv, "--env", "") else None


def _recorded(run: RunDirectory) -> dict[str, Any]:
    """Return the options that the run was started with, whatever command did it."""
    names = {"env": "env", "algo": "algorithm", "backend": "backend", "seed": "seed", "num_worlds": "num_worlds"}
    recorded = {option: run.fact(key) for option, key in names.items()}
    preset = run.manifest.get("preset") or {"name": ""}
    steps = float(run.fact("total_steps"))
    return {**recorded, "total_steps": steps, "preset": preset["name"], "algorithm": run.config}


def _preset(options: Any, algorithm: Algorithm) -> dict[str, Any] | None:
    """Return what the manifest says of the preset."""
    if not options.preset:
        return None
    changed = find_preset(algorithm, options.preset).changed(
        total_steps=whole_steps(options.total_steps), num_worlds=options.num_worlds, config=options.algorithm
    )
    return {"name": options.preset, "changed": changed}


def _check_folder(out: Path, resume: bool) -> None:
    """Refuse to go on with what is not there, or to start where something is."""
    if resume:
        RunDirectory.open(out)
    elif out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise RunError(f"{out}: exists and is not empty: choose another folder, or resume the run with --resume")


def _epoch_steps(training: Training) -> int:
    """Return the steps of an epoch: whole episodes of all worlds; 0 where the algorithm knows no such epochs."""
    steps = getattr(training.config, "steps_per_epoch", None)
    if steps is None or training.num_worlds < 1:  # other epochs, or no worlds, which the backend refuses
        return 0
    return whole_episodes(steps, training.num_worlds, training.spec.episode_length)


def _rounded(training: Training, epoch: int, steps: int) -> Iterator[str]:
    """Yield a line on each number that is not what the options say, because epochs are of whole episodes."""
    asked = getattr(training.config, "steps_per_epoch", epoch)
    if epoch != asked:
        episodes = epoch // training.spec.episode_length
        yield f"an epoch is {epoch:,} steps, not {asked:,}: {episodes} whole episodes in {training.num_worlds} worlds\n"
    if steps > training.total_steps:
        yield f"trains {steps:,} steps, not {training.total_steps:,}: rounded up to whole epochs of {epoch:,}\n"


def _train(training: Training, workers: int | None, steps: int, quiet: bool) -> bool:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps"),
        TextColumn("{task.fields[metrics]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with stop_request() as stop, Progress(*columns, disable=quiet) as progress:
        bar = progress.add_task(f"{training.algorithm} on {training.backend}", total=steps, metrics="")

        def report(row: Mapping[str, float]) -> None:
            metrics = f"return {row['return_mean']:.2f}  cost {row['cost_mean']:.2f}  {row['steps_per_second']:,.0f}/s"
            progress.update(bar, completed=row["total_steps"], metrics=metrics)

        def warn(finding: Finding) -> None:
            print_line(f"warning: {finding}", progress.console, quiet)

        def note(sentence: str) -> None:
            print_line(f"approximation: {sentence}", progress.console, quiet)

        return train(training, report, stop, workers, warn, note)


def _print_summary(run: RunDirectory, as_json: bool) -> None:
    rows = run.rows()
    if not rows:
        return
    if as_json:
        print_json({"out": str(run.path), **rows[-1]})
        return
    shown = ("epoch", "total_steps", "return_mean", "cost_mean", "violation_rate", "success_mean", "kl")
    print_table(f"last epoch of {run.path}", ("", "value"), [(key, rows[-1].get(key, float("nan"))) for key in shown])
