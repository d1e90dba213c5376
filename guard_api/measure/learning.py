"""Training runs side by side: found on disk, grouped by what was trained, compared over their seeds."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from guard_api import plugins
from guard_api.algorithm import deciding_names
from guard_api.errors import PluginError, RunError, SpecError
from guard_api.measure.statistics import Bootstrap, Estimate
from guard_api.runs.atomic import read_json
from guard_api.runs.directory import FORMAT
from guard_api.runs.progress import read_rows

FACTS: Final = ("env", "spec_fingerprint", "algorithm", "backend", "num_worlds", "seed")
"""What the manifests of runs that are compared must hold."""


class _HasEnvironment(Protocol):
    @property
    def env(self) -> str: ...


_OfEnvironment = TypeVar("_OfEnvironment", bound=_HasEnvironment)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One training as it stands on disk. rows: of progress.csv, at least one, oldest first."""

    path: Path
    manifest: dict[str, Any]
    config: dict[str, Any]
    rows: list[dict[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Runs that differ in nothing but their seed, in the order of the seeds.

    label: the algorithm, with what tells it from the other groups of its environment where the name alone does not.
    """

    env: str
    algorithm: str
    backend: str
    label: str
    runs: tuple[Run, ...]

    @property
    def seeds(self) -> list[int]:
        """The training seeds."""
        return [int(run.manifest["seed"]) for run in self.runs]

    @property
    def epochs(self) -> int:
        """How many epochs every run has."""
        return min(len(run.rows) for run in self.runs)

    @property
    def steps(self) -> NDArray[np.float64]:
        """Environment steps (E,) after each epoch that every run has."""
        return np.array([row["total_steps"] for row in self.runs[0].rows[: self.epochs]])

    @property
    def uneven(self) -> bool:
        """Whether some runs have gone further than others: what lies beyond the shortest one is left out."""
        return len({len(run.rows) for run in self.runs}) > 1

    def values(self, column: str) -> NDArray[np.float64]:
        """Return a column (K, E) of every run's epochs. Raises RunError naming a run that does not have it."""
        for run in self.runs:
            if any(column not in row for row in run.rows[: self.epochs]):
                raise RunError(f"{run.path / 'progress.csv'}: has no column {column!r} in every row: train it again")
        return np.array([[row[column] for row in run.rows[: self.epochs]] for run in self.runs])

    def final(self, column: str, epochs: int = 1) -> Estimate:
        """Estimate a column's mean over seeds, of each seed's mean over the last `epochs` that every run has."""
        last = self.values(column)[:, -epochs:].mean(axis=1)
        return Bootstrap(len(self.runs), 1).mean(last[:, None])


def read_groups(folders: Sequence[Path]) -> list[Group]:
    """Return the groups of all runs in `folders`, at any depth, by environment, algorithm and backend.

    Raises RunError where a folder holds no run with a finished epoch, or one seed is there twice.
    """
    runs = [run for folder in folders for run in _runs(folder)]
    unique = {run.path.resolve(): run for run in runs}
    grouped: dict[tuple[str, ...], list[Run]] = {}
    for run in unique.values():
        grouped.setdefault(_identity(run), []).append(run)
    labels = _labels([members[0] for members in grouped.values()])
    groups = [
        Group(
            env=str(members[0].manifest["env"]),
            algorithm=str(members[0].manifest["algorithm"]),
            backend=str(members[0].manifest["backend"]),
            label=label,
            runs=_by_seed(members),
        )
        for label, members in zip(labels, grouped.values(), strict=True)
    ]
    return sorted(groups, key=lambda group: (group.env, group.label, group.backend))


def by_environment(members: Sequence[_OfEnvironment]) -> dict[str, list[_OfEnvironment]]:
    """Return the members, anything with an `env`, of each environment."""
    result: dict[str, list[_OfEnvironment]] = {}
    for one in members:
        result.setdefault(one.env, []).append(one)
    return result


def _runs(folder: Path) -> Iterable[Run]:
    if not folder.is_dir():
        raise RunError(f"{folder}: no such folder: name run directories, or folders of them")
    found = []
    for file in sorted(folder.rglob("manifest.json")):
        manifest = read_json(file, "restore it from a copy")
        rows = read_rows(file.parent / "progress.csv") if manifest.get("format") == FORMAT else []
        missing = [key for key in FACTS if key not in manifest]
        if rows and missing:
            raise RunError(f"{file}: has no {missing[0]}: restore it from a copy, or train again")
        if rows:
            config = read_json(file.parent / "config.json", "restore it from a copy")
            found.append(Run(path=file.parent, manifest=manifest, config=config, rows=rows))
    if not found:
        raise RunError(f"{folder}: holds no run with a finished epoch: `guard suite` or `guard train` makes some")
    return found


def _identity(run: Run) -> tuple[str, ...]:
    """Return all that must agree for two runs to be seeds of the same thing."""
    return (*(str(run.manifest[name]) for name in FACTS if name != "seed"), json.dumps(_options(run), sort_keys=True))


def _options(run: Run) -> dict[str, Any]:
    """Return the options that decide numbers; all of them where the algorithm is not installed here."""
    try:
        config_type = plugins.load("guard.algorithms", str(run.manifest["algorithm"])).config_type
    except (PluginError, SpecError):
        return run.config
    return {name: run.config[name] for name in deciding_names(config_type) if name in run.config}


def _by_seed(members: list[Run]) -> tuple[Run, ...]:
    ordered = sorted(members, key=lambda run: run.manifest["seed"])
    for one, other in pairwise(ordered):
        if one.manifest["seed"] == other.manifest["seed"]:
            seed = one.manifest["seed"]
            raise RunError(f"{one.path} and {other.path}: the same training with the same seed {seed}: leave one out")
    return tuple(ordered)


def _labels(runs: Sequence[Run]) -> list[str]:
    """Return a label for each group: the algorithm, the options that differ between groups, their other differences."""
    labels = []
    for run in runs:
        algorithm = run.manifest["algorithm"]
        rivals = [
            other
            for other in runs
            if all(other.manifest[name] == run.manifest[name] for name in ("env", "algorithm", "backend"))
        ]
        differing = {
            name: value
            for name, value in (_options(run) | {"num_worlds": run.manifest["num_worlds"]}).items()
            if any(
                (_options(other) | {"num_worlds": other.manifest["num_worlds"]}).get(name) != value for other in rivals
            )
        }
        said = ", ".join(f"{name}={value}" for name, value in sorted(differing.items()))
        versions = {other.manifest["spec_fingerprint"] for other in rivals}
        said += f"{', ' if said else ''}spec {run.manifest['spec_fingerprint'][:6]}" if len(versions) > 1 else ""
        labels.append(f"{algorithm} ({said})" if said else str(algorithm))
    return labels
