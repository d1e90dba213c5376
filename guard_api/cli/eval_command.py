"""`guard eval`: evaluate a trained policy on any backend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from guard_api import plugins
from guard_api.algorithm import Policy
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.env import make_environment
from guard_api.errors import RunError, SpecError
from guard_api.measure.rollout import EpisodeTable, evaluate
from guard_api.measure.training import final_checkpoint
from guard_api.runs.directory import RunDirectory
from guard_api.spec import EnvSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which policy, where, and how long."""

    run: Annotated[Path, tyro.conf.Positional]
    """Run directory of the policy."""
    checkpoint: Literal["last", "best"] = "last"
    """Which of its policies: the last one, or the best of the epochs within the limits (see the algorithm)."""
    backend: str | None = None
    """Simulator to evaluate in; the one it was trained in when left out."""
    episodes: int = 100
    """Number of episodes."""
    num_worlds: int = 25
    """Worlds stepped together; part of the protocol, since it decides which layouts are played."""
    seed: int = 1_000_000
    """Seed of the layouts; the same seed gives the same layouts in every backend."""
    stochastic: bool = False
    """Sample actions instead of taking the mean."""
    json: bool = False
    """Print JSON, with every episode, instead of a table."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "eval", argv, "Evaluate a trained policy on any backend.")
    if options.episodes < 1:
        raise SpecError(f"--episodes is {options.episodes}: it must be at least 1")
    run = RunDirectory.open(options.run)
    backend = options.backend or str(run.fact("backend"))
    policy = _load_policy(run, options.checkpoint)
    spec = EnvSpec.from_json(run.fact("spec"))
    worlds = min(options.num_worlds, options.episodes)
    env = make_environment(spec, backend=backend, num_worlds=worlds, seed=options.seed)
    try:
        approximations = list(env.world.approximations)
        table = evaluate(policy, env, options.episodes, deterministic=not options.stochastic)
    finally:
        env.close()
    trained = f"{run.fact('algorithm')}, trained in {run.fact('backend')}"
    if options.json:
        print_json(
            {
                "run": str(options.run),
                "backend": backend,
                "checkpoint": options.checkpoint,
                "policy": trained,
                "approximations": approximations,
                **table.to_json(),
            }
        )
    else:
        for sentence in approximations:
            print(f"approximation: {sentence}")
        _print(f"{options.run} ({trained}) in {backend}: {options.episodes} episodes of {spec.name}", table)
    return 0


def _load_policy(run: RunDirectory, which: Literal["last", "best"]) -> Policy:
    checkpoint = run.best_checkpoint() if which == "best" else final_checkpoint(run)
    if checkpoint is None:
        raise RunError(f"{run.path}: has no best checkpoint: its algorithm keeps none, or it was stopped too early")
    return plugins.load("guard.algorithms", str(run.fact("algorithm"))).load_policy(checkpoint)


def _print(title: str, table: EpisodeTable) -> None:
    columns = {"return": table.returns, "cost": table.cost}
    if len(table.cost_names) > 1:
        columns |= {f"cost {name}": table.costs[:, i] for i, name in enumerate(table.cost_names)}
    columns |= {"violation rate": table.violation, "goals": table.goals.astype(float)}
    rows = [[name, float(v.mean()), float(v.std()), float(v.min()), float(v.max())] for name, v in columns.items()]
    print_table(title, ("per episode", "mean", "std", "min", "max"), rows)
    if table.failed.any():
        print(f"{int(table.failed.sum())} episodes ended by a failure: {sorted(set(table.failures.values()))}")
