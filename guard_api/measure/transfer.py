"""The transfer experiment: train in some backends, run every policy in every backend, write down what changed.

A folder holds `plan.json`; `train/<backend>/seed<k>/`, one run directory each; `cells/*.json`, one policy in one
backend each; and, once all are there, `transfer.json`, from which `matrix.png` and `report.html` are made. Nothing
finished is done again, so the same command goes on after an interruption.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

from guard_api import plugins
from guard_api.algorithm import Algorithm, Policy
from guard_api.env import Environment, make_environment
from guard_api.errors import RunError
from guard_api.measure.plan import TransferPlan, claim_folder
from guard_api.measure.pool import Warned, train_all
from guard_api.measure.result import TRANSFER_FORMAT
from guard_api.measure.rollout import EpisodeTable, RandomPolicy, evaluate
from guard_api.measure.statistics import COVERAGE, REPLICATES
from guard_api.measure.summary import RANDOM, Tables, summarise
from guard_api.measure.training import FINISHED, Training, is_trained
from guard_api.runs.atomic import read_json, write_json
from guard_api.runs.directory import RunDirectory
from guard_api.runs.manifest import asset_hashes, describe_machine, package_versions

CELL_FORMAT: Final = "guard-cell-1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """What just happened: an epoch of a training, or one policy run in one backend.

    row: the epoch's metrics, for "train"; done of total: policies trained, or cells evaluated, so far.
    """

    stage: Literal["train", "evaluate"]
    source: str
    target: str
    seed: int
    done: int
    total: int
    row: Mapping[str, float] | None = None


def run_transfer(
    plan: TransferPlan,
    out: Path | str,
    *,
    jobs: int = 1,
    workers: int | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
    warned: Warned = lambda training, finding: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Path | None:
    """Run what is missing of `plan` in the folder `out`; return its transfer.json, or None when `should_stop` ended it.

    jobs: trainings at a time. workers: threads or processes that step the worlds of one environment. warned: learns of
    what goes wrong in a training.
    Raises RunError when `out` belongs to another plan, and whatever a plugin raises; the same call goes on afterwards.
    """
    out = Path(out)
    claim_folder(plan, out)
    counter = _TrainingCounter(plan, out, report)
    if not train_all(plan.trainings(out), counter, should_stop, jobs=jobs, workers=workers, warned=warned):
        return None
    if not _evaluate_all(plan, out, workers, report, should_stop):
        return None
    claim_folder(plan, out)  # again: a robot file may have been edited since
    path = out / "transfer.json"
    write_json(path, _result(plan, out))
    return path


class _TrainingCounter:
    """Turns training rows into `Progress`; a run is done with the row that reaches its steps."""

    def __init__(self, plan: TransferPlan, out: Path, report: Callable[[Progress], None]) -> None:
        self._trainings, self._report = plan.trainings(out), report
        self._trained: set[Path] = set()

    def __call__(self, training: Training, row: Mapping[str, float]) -> None:
        self._trained |= {one.path for one in self._trainings if is_trained(one)}
        if row["total_steps"] >= training.total_steps:
            self._trained.add(training.path)
        self._report(
            Progress(
                stage="train",
                source=training.backend,
                target=training.backend,
                seed=training.seed,
                done=len(self._trained),
                total=len(self._trainings),
                row=row,
            )
        )


def _evaluate_all(
    plan: TransferPlan,
    out: Path,
    workers: int | None,
    report: Callable[[Progress], None],
    should_stop: Callable[[], bool],
) -> bool:
    sources = (*plan.sources, RANDOM)
    total = len(plan.backends) * len(sources) * len(plan.seeds)
    done = 0
    for target in plan.backends:
        todo = [(s, k) for s in sources for k in plan.seeds if not _cell_path(out, s, target, k).exists()]
        done += len(sources) * len(plan.seeds) - len(todo)
        if not todo:
            continue
        worlds = min(plan.eval_worlds, plan.episodes)
        env = make_environment(plan.spec, backend=target, num_worlds=worlds, workers=workers)
        try:
            for source, seed in todo:
                if should_stop():
                    return False
                _evaluate_cell(plan, out, env, source, target, seed)
                done += 1
                report(Progress(stage="evaluate", source=source, target=target, seed=seed, done=done, total=total))
        finally:
            env.close()
    return True


def _evaluate_cell(plan: TransferPlan, out: Path, env: Environment, source: str, target: str, seed: int) -> None:
    stream = plan.evaluation_seed + seed
    checkpoint = None if source == RANDOM else _final_checkpoint(plan.training(out, source, seed).path)
    policy: Policy
    if checkpoint is None:
        policy = RandomPolicy(env.action_size, stream)
    else:
        algorithm: Algorithm = plugins.load("guard.algorithms", plan.algorithm)
        policy = algorithm.load_policy(checkpoint)
    table = evaluate(policy, env, plan.episodes, seed=stream)
    cell = {
        "format": CELL_FORMAT,
        "fingerprint": plan.fingerprint,
        "source": source,
        "target": target,
        "seed": seed,
        "checkpoint": None if checkpoint is None else checkpoint.relative_to(out).as_posix(),
        "approximations": list(env.world.approximations),
        "made": {**describe_machine(), "versions": package_versions()},
        "episodes": table.to_json(),
    }
    write_json(_cell_path(out, source, target, seed), cell)


def _final_checkpoint(path: Path) -> Path:
    """Return the final policy's checkpoint: the rule is the last one, never one chosen by its results."""
    name = read_json(path / FINISHED, f"delete {path} to train it again").get("checkpoint")
    return path / "checkpoints" / str(name)


def _cell_path(out: Path, source: str, target: str, seed: int) -> Path:
    return out / "cells" / f"{source}_in_{target}_seed{seed}.json"


def _read_cell(plan: TransferPlan, out: Path, source: str, target: str, seed: int) -> dict[str, Any]:
    path = _cell_path(out, source, target, seed)
    remedy = "delete this file and run the same command again"
    cell = read_json(path, remedy)
    if cell.get("format") != CELL_FORMAT or cell.get("fingerprint") != plan.fingerprint:
        raise RunError(f"{path}: not a cell of this plan ({plan.fingerprint}): {remedy}")
    return cell


def _result(plan: TransferPlan, out: Path) -> dict[str, Any]:
    raw = {
        (source, target): [_read_cell(plan, out, source, target, seed) for seed in plan.seeds]
        for source in (*plan.sources, RANDOM)
        for target in plan.backends
    }
    tables: Tables = {key: [EpisodeTable.from_json(c["episodes"]) for c in cells] for key, cells in raw.items()}
    runs = {(b, k): RunDirectory.open(plan.training(out, b, k).path) for b in plan.sources for k in plan.seeds}
    cells, transfers = summarise(tables, plan.limit)
    return {
        "format": TRANSFER_FORMAT,
        "manifest": _manifest(plan, out, raw, [run.manifest["git"] for run in runs.values()]),
        "backends": list(plan.backends),
        "sources": list(plan.sources),
        "seeds": list(plan.seeds),
        "cost_names": list(tables[RANDOM, plan.backends[0]][0].cost_names),
        "cost_limit": plan.limit,
        "cells": [
            {
                **cell.to_json(),
                "runs": [
                    {"seed": one["seed"], "checkpoint": one["checkpoint"], "episodes": one["episodes"]}
                    for one in raw[cell.source, cell.target]
                ],
            }
            for cell in cells
        ],
        "transfers": [transfer.to_json() for transfer in transfers],
        "training": [{"backend": b, "seed": k, "rows": run.rows()} for (b, k), run in runs.items()],
    }


def _manifest(
    plan: TransferPlan, out: Path, raw: Mapping[tuple[str, str], list[dict[str, Any]]], trained_with: list[Any]
) -> dict[str, Any]:
    """Return what decided the numbers; machine, versions and command are those of the newest cell.

    raw: the cells of every (source, target). trained_with: the git states of the trainings.
    """
    engines = read_json(out / "plan.json", "choose another folder")["versions"]
    made = sorted((cell["made"] for cells in raw.values() for cell in cells), key=lambda made: made["started"])
    states = [*trained_with, *(one["git"] for one in made)]
    return {
        "env": plan.spec.name,
        "spec": plan.spec.to_json(),
        "spec_fingerprint": plan.spec.fingerprint,
        "plan_fingerprint": plan.fingerprint,
        "algorithm": plan.algorithm,
        "config": asdict(plan.config),
        "total_steps": plan.total_steps,
        "num_worlds": plan.num_worlds,
        "episodes": plan.episodes,
        "eval_worlds": min(plan.eval_worlds, plan.episodes),
        "evaluation_seed": plan.evaluation_seed,
        "deterministic": True,
        "bootstrap": {"replicates": REPLICATES, "coverage": {str(k): value for k, value in COVERAGE.items()}},
        "approximations": {b: raw[RANDOM, b][0]["approximations"] for b in plan.backends},
        "engines": {name: engines[name] for name in plan.backends},
        "assets": asset_hashes(plan.spec.robot),
        "commits": [state for index, state in enumerate(states) if state not in states[:index]],
        **made[-1],
    }
