"""Training one policy into its run directory, resumable at any moment."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from guard_api import plugins
from guard_api.algorithm import TrainingJob, check_row, deciding_options
from guard_api.env import make_environment
from guard_api.errors import BackendError, RunError
from guard_api.measure.diagnosis import Finding, cost_limits, diagnose, from_jsonl, to_jsonl
from guard_api.runs.atomic import read_json, write_json, write_text
from guard_api.runs.directory import RunDirectory
from guard_api.runs.manifest import build_manifest
from guard_api.spec import EnvSpec

FINISHED: Final = "finished.json"
"""Marks a run directory whose training reached its steps; names them and the checkpoint of the final policy."""

DIAGNOSIS: Final = "diagnosis.jsonl"
"""What went wrong in a run, one finding per line; missing where nothing did."""

_DECIDERS: Final = {"backend": "--backend", "algorithm": "--algo", "seed": "--seed", "num_worlds": "--num-worlds"}
"""What of a manifest must agree for a training to go on, beside environment and robot -> its option."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """One policy to be trained in the run directory `path`.

    config: an instance of the algorithm's `config_type`. preset: the named settings that the
    options started from, and what of them was changed: see `build_manifest`.
    """

    path: Path
    spec: EnvSpec
    backend: str
    algorithm: str
    config: Any
    seed: int
    total_steps: int
    num_worlds: int
    preset: Mapping[str, Any] | None = None


def is_trained(training: Training) -> bool:
    """Return whether its run directory holds the final policy of at least as many steps."""
    file = training.path / FINISHED
    if not file.exists():
        return False
    found = read_json(file, "delete it to check the run again")
    # Before the steps were written down, only transfer experiments left this file, whose steps never change.
    enough = found.get("total_steps", training.total_steps) >= training.total_steps
    return enough and (training.path / "checkpoints" / str(found.get("checkpoint"))).is_dir()


def final_checkpoint(run: RunDirectory) -> Path:
    """Return the checkpoint of the final policy, or of the last one so far. Raises RunError where it is gone."""
    again = f"`guard train --resume --out {run.path}`"
    if (run.path / FINISHED).exists():
        name = read_json(run.path / FINISHED, "delete it to check the run again").get("checkpoint")
        path = run.path / "checkpoints" / str(name)
        if not path.is_dir():
            raise RunError(f"{path}: the final policy is gone: {again} trains it again from the checkpoint before it")
        return path
    last = run.last_checkpoint()
    if last is None:
        raise RunError(f"{run.path}: has no checkpoint yet: train it longer with {again}")
    return last


def findings(training: Training) -> list[Finding]:
    """Return what `diagnosis.jsonl` says of its run directory: what went wrong so far, by epoch."""
    file = training.path / DIAGNOSIS
    return from_jsonl(file) if file.exists() else []


def train(
    training: Training,
    report: Callable[[Mapping[str, float]], None],
    should_stop: Callable[[], bool],
    workers: int | None = None,
    warn: Callable[[Finding], None] = lambda finding: None,
    note: Callable[[str], None] = lambda sentence: None,
) -> bool:
    """Train it, going on from its last checkpoint if there is one; return whether it is finished.

    report: called with the metrics row after every epoch. warn: called with what goes wrong (`diagnosis`), of which
    `diagnosis.jsonl` keeps the whole list. note: called before the first epoch with what the simulator can only
    approximate, which the manifest keeps. Raises RunError where the run directory is of another
    training, naming what differs, and whatever the plugins raise.
    """
    if is_trained(training):
        with contextlib.closing(RunDirectory.open(training.path)) as run:
            _check(training, run, _manifest(training))
        return True
    algorithm = plugins.load("guard.algorithms", training.algorithm)
    env = make_environment(
        training.spec,
        backend=training.backend,
        num_worlds=training.num_worlds,
        seed=training.seed,
        workers=workers,
    )
    try:
        with _opened(training, env.world.approximations) as (run, resume):
            for sentence in env.world.approximations:
                note(sentence)
            doctor = _Doctor(run, cost_limits(training.config), env.action_size, warn)

            def after_epoch(row: Mapping[str, float]) -> None:
                check_row(training.algorithm, row)
                doctor.look()
                report(row)

            job = TrainingJob(
                env=env,
                run=run,
                config=training.config,
                total_steps=training.total_steps,
                seed=training.seed,
                resume=resume,
                report=after_epoch,
                should_stop=should_stop,
            )
            try:
                finished = algorithm.train(job)
            except BackendError as error:
                if run.last_checkpoint() is None:  # nothing to go on from
                    raise
                where = f"seed {training.seed}, epoch {len(run.rows()) + 1}"
                again = f"`guard train --resume --out {run.path}` goes on from the last checkpoint"
                raise BackendError(f"{error} ({where}; {again})") from error
            if not finished:
                return False
            last = run.last_checkpoint()
    finally:
        env.close()
    if last is None:
        raise RunError(
            f"{training.path}: {training.algorithm} finished without leaving a checkpoint: its plugin is at fault"
        )
    write_json(training.path / FINISHED, {"checkpoint": last.name, "total_steps": training.total_steps})
    return True


class _Doctor:
    """Diagnoses a run after every epoch: keeps `diagnosis.jsonl` up to date and warns of what is new."""

    def __init__(
        self, run: RunDirectory, limits: Mapping[str, float], action_size: int, warn: Callable[[Finding], None]
    ) -> None:
        self._run, self._limits, self._action_size, self._warn = run, limits, action_size, warn
        self._written: list[Finding] | None = None

    def look(self) -> None:
        """Look at all rows of the log; an interrupted run's file may know of epochs that are trained again."""
        rows = self._run.rows()
        findings = diagnose(rows, limits=self._limits, action_size=self._action_size)
        file = self._run.path / DIAGNOSIS
        if findings != self._written and (findings or file.exists()):
            write_text(file, to_jsonl(findings))
        self._written = findings
        for finding in findings:
            if finding.epoch == rows[-1]["epoch"]:
                self._warn(finding)


@contextlib.contextmanager
def _opened(training: Training, approximations: Sequence[str]) -> Iterator[tuple[RunDirectory, bool]]:
    """Open the run directory for the block, with whether it can be resumed.

    One that was made here is deleted where the training fails before its first row, as when the algorithm refuses its
    options: the corrected command shall find the folder free.
    """
    path, config = training.path, asdict(training.config)
    manifest = {**_manifest(training), "approximations": list(approximations)}
    made = not (path.exists() and any(path.iterdir()))
    run = RunDirectory.create(path, manifest=manifest, config=config) if made else RunDirectory.open(path)
    with run.locked(), contextlib.closing(run if made else _taken_up(training, run, manifest)) as run:
        try:
            yield run, run.last_checkpoint() is not None
        except Exception:
            if made and not run.rows() and run.last_checkpoint() is None:
                run.delete()
            raise


def _taken_up(training: Training, run: RunDirectory, manifest: dict[str, Any]) -> RunDirectory:
    """Return the run as the training goes on with it from the last checkpoint; without one it begins anew."""
    resume = run.last_checkpoint() is not None
    if resume or run.rows():  # otherwise it never began
        _check(training, run, manifest)
    if resume:
        run.set_total_steps(training.total_steps)
    (training.path / FINISHED).unlink(missing_ok=True)  # of fewer steps
    if resume:
        return run
    (training.path / DIAGNOSIS).unlink(missing_ok=True)
    return run.restart(manifest=manifest, config=asdict(training.config))


def _manifest(training: Training) -> dict[str, Any]:
    return build_manifest(
        env_spec=training.spec,
        backend=plugins.load("guard.backends", training.backend),
        algorithm=training.algorithm,
        seed=training.seed,
        num_worlds=training.num_worlds,
        total_steps=training.total_steps,
        preset=training.preset,
    )


def _check(training: Training, run: RunDirectory, manifest: Mapping[str, Any]) -> None:
    """Raise RunError where `run` is not one of this training; options that change no number may differ."""
    remedy = f"go on with the options of `{run.manifest.get('command')}`, or choose another folder"
    for key in ("spec_fingerprint", "assets"):
        if run.manifest.get(key) != manifest[key]:
            raise RunError(f"{run.path}: was made with {_environment(run.manifest, manifest, key)}: {remedy}")
    for key, flag in _DECIDERS.items():
        if run.manifest.get(key) != manifest[key]:
            found = run.manifest.get(key)
            raise RunError(f"{run.path}: was made with {flag} {found!r}, not {manifest[key]!r}: {remedy}")
    for key, value in deciding_options(training.config).items():
        if run.config.get(key) != value:
            flag, found = f"--{key.replace('_', '-')}", run.config.get(key)
            raise RunError(f"{run.path}: was made with {flag} {found!r}, not {value!r}: {remedy}")


def _environment(old: Mapping[str, Any], new: Mapping[str, Any], key: str) -> str:
    """Return how the environment of the manifest `old` differs from that of `new`."""
    if key == "assets":
        return f"other files of the robot of {new['env']}"
    if old.get("env") != new["env"]:
        return f"--env {old.get('env')}, not {new['env']}"
    return f"another specification of --env {new['env']}"
