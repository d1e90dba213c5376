"""`guard train`: train a policy on one backend, into a run directory that can be resumed."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import tyro
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from guard_api import plugins
from guard_api.algorithm import Algorithm, TrainingJob
from guard_api.cli.interrupt import stop_request
from guard_api.cli.options import parse_with_algorithm, whole_steps
from guard_api.cli.output import print_json, print_table
from guard_api.env import make_environment
from guard_api.errors import RunError
from guard_api.runs.directory import RunDirectory
from guard_api.runs.manifest import build_manifest
from guard_api.suite import make_spec

Config = TypeVar("Config")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(Generic[Config]):
    """What to train, where and for how long; the algorithm's own options follow."""

    env: str
    """Environment, such as Goal_Point_8Hazards (`guard list envs`), or a TOML file that specifies one."""
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
    resume: bool = False
    """Continue from the last checkpoint in --out, to the same bits as without the interruption."""
    json: bool = False
    """Print the last epoch's metrics as JSON."""
    algorithm: Annotated[Config, tyro.conf.arg(name="")]
    """Options of the algorithm."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options, algorithm = parse_with_algorithm(Options, "train", argv, "Train a policy on one backend.")
    total_steps = whole_steps(options.total_steps)
    spec = make_spec(options.env)
    manifest = build_manifest(
        env_spec=spec,
        backend=plugins.load("guard.backends", options.backend),
        algorithm=algorithm.name,
        seed=options.seed,
        num_worlds=options.num_worlds,
        total_steps=total_steps,
    )
    config = dataclasses.asdict(options.algorithm)
    env = make_environment(
        spec, backend=options.backend, num_worlds=options.num_worlds, seed=options.seed, workers=options.workers
    )
    try:
        with closing(_run_directory(options, manifest, config)) as run:
            finished = _train(algorithm, env, run, options, total_steps)
    finally:
        env.close()
    _print_summary(run, options.json)
    if not finished:
        raise KeyboardInterrupt
    return 0


def _run_directory(options: Any, manifest: Mapping[str, Any], config: Mapping[str, Any]) -> RunDirectory:
    """Make the run directory, or open it to resume; refuses to resume a run of anything else."""
    if not options.resume:
        return RunDirectory.create(options.out, manifest=manifest, config=config)
    run = RunDirectory.open(options.out)
    for key in ("spec_fingerprint", "assets", "backend", "algorithm", "seed", "num_worlds"):
        if run.manifest.get(key) != manifest[key]:
            raise RunError(
                f"{options.out}: was made with {key} = {run.manifest.get(key)!r}, not {manifest[key]!r}: "
                "resume with the options it was made with, or choose another --out"
            )
    for key, value in json.loads(json.dumps(config)).items():  # as the run's config.json says it
        if run.config.get(key) != value:
            raise RunError(
                f"{options.out}: was made with --{key.replace('_', '-')} {run.config.get(key)!r}, not {value!r}: "
                "resume with the options it was made with, or choose another --out"
            )
    return run


def _train(algorithm: Algorithm, env: Any, run: RunDirectory, options: Any, total_steps: int) -> bool:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps"),
        TextColumn("{task.fields[metrics]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with stop_request() as stop, Progress(*columns, disable=options.json) as progress:
        bar = progress.add_task(f"{algorithm.name} on {options.backend}", total=total_steps, metrics="")

        def report(row: Mapping[str, float]) -> None:
            metrics = f"return {row['return_mean']:.2f}  cost {row['cost_mean']:.2f}  {row['steps_per_second']:,.0f}/s"
            progress.update(bar, completed=row["total_steps"], metrics=metrics)

        return algorithm.train(
            TrainingJob(
                env=env,
                run=run,
                config=options.algorithm,
                total_steps=total_steps,
                seed=options.seed,
                resume=options.resume,
                report=report,
                should_stop=stop,
            )
        )


def _print_summary(run: RunDirectory, as_json: bool) -> None:
    rows = run.rows()
    if not rows:
        return
    if as_json:
        print_json({"out": str(run.path), **rows[-1]})
        return
    shown = ("epoch", "total_steps", "return_mean", "cost_mean", "violation_rate", "success_mean", "kl")
    print_table(f"last epoch of {run.path}", shown, [[rows[-1].get(key, float("nan")) for key in shown]])
