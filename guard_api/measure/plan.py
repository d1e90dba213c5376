"""A transfer experiment as data: what is trained, how it is evaluated, and which results belong to it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import guard_api
from guard_api import plugins
from guard_api.algorithm import deciding_options
from guard_api.errors import RunError, SpecError
from guard_api.measure.training import Training
from guard_api.runs.atomic import read_json, write_json
from guard_api.runs.manifest import asset_hashes
from guard_api.spec import EnvSpec

PLAN_FORMAT: Final = "guard-transfer-plan-2"


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferPlan:
    """Train `algorithm` in the backends `train_on` with every seed; run every policy in all `backends`.

    train_on: a subset of `backends`; empty for all of them.
    config: an instance of the algorithm's `config_type`. total_steps, num_worlds: of each training.
    episodes: per policy and backend. eval_worlds: worlds of an evaluation; part of the plan, because the start of an
    episode depends on which world plays it. evaluation_seed: policies of training seed k are evaluated on the streams
    of seed `evaluation_seed + k`, in every backend. cost_limit: of the summed episode cost, for verdicts only; None
    takes the one of `config`, if it has one.
    """

    spec: EnvSpec
    algorithm: str
    config: Any
    backends: tuple[str, ...]
    train_on: tuple[str, ...] = ()
    seeds: tuple[int, ...]
    total_steps: int
    num_worlds: int = 30
    episodes: int = 100
    eval_worlds: int = 25
    evaluation_seed: int = 1_000_000
    cost_limit: float | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be measured."""
        for name in ("backends", "seeds"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise SpecError(f"{name} = {list(values)}: give at least one, each once")
        strangers = sorted(set(self.train_on) - set(self.backends))
        if strangers or len(set(self.train_on)) < len(self.train_on):
            raise SpecError(
                f"train_on = {list(self.train_on)}: must be some of the backends {list(self.backends)}, each once"
            )
        for name in ("total_steps", "num_worlds", "episodes", "eval_worlds"):
            if getattr(self, name) < 1:
                raise SpecError(f"{name} = {getattr(self, name)}: must be at least 1")
        both = set(self.seeds) & {self.evaluation_seed + seed for seed in self.seeds}
        if min(self.seeds) < 0 or both:
            raise SpecError(
                f"seeds = {list(self.seeds)}: must not be negative nor reach the evaluation's {sorted(both)}"
            )

    @property
    def sources(self) -> tuple[str, ...]:
        """The backends that policies are trained in."""
        return self.train_on or self.backends

    @property
    def limit(self) -> float | None:
        """The limit that verdicts use."""
        if self.cost_limit is not None or getattr(self.config, "cost_limits", None):
            return self.cost_limit
        limit = getattr(self.config, "cost_limit", None)
        return None if limit is None else float(limit)

    def training(self, out: Path, backend: str, seed: int) -> Training:
        """Return the training of `seed` in `backend`, in the folder `out`."""
        return Training(
            path=out / "train" / backend / f"seed{seed}",
            spec=self.spec,
            backend=backend,
            algorithm=self.algorithm,
            config=self.config,
            seed=seed,
            total_steps=self.total_steps,
            num_worlds=self.num_worlds,
        )

    def trainings(self, out: Path) -> list[Training]:
        """Return all trainings, by backend and then seed."""
        return [self.training(out, backend, seed) for backend in self.sources for seed in self.seeds]

    def deciders(self) -> dict[str, Any]:
        """Return everything that decides a single result, JSON-serialisable: not which backends and seeds there are."""
        return {
            "env": self.spec.name,
            "spec_fingerprint": self.spec.fingerprint,
            **{f"assets.{file}": digest for file, digest in asset_hashes(self.spec.robot).items()},
            "algorithm": self.algorithm,
            **{f"config.{name}": value for name, value in deciding_options(self.config).items()},
            "total_steps": self.total_steps,
            "num_worlds": self.num_worlds,
            "episodes": self.episodes,
            "eval_worlds": self.eval_worlds,
            "evaluation_seed": self.evaluation_seed,
        }

    @property
    def fingerprint(self) -> str:
        """A 16-digit hash of the deciders: results with another one must not be mixed in."""
        return hashlib.sha256(json.dumps(self.deciders(), sort_keys=True).encode()).hexdigest()[:16]


def claim_folder(plan: TransferPlan, out: Path) -> None:
    """Make `out` the folder of this plan, and write down the versions that its numbers come from.

    Backends and seeds may be added to a folder later. Raises RunError, naming what differs, when `out` holds the
    results of another plan or of other engine versions, or something else altogether.
    """
    file = out / "plan.json"
    versions: dict[str, dict[str, str]] = {"guard": {"guard": guard_api.__version__}}
    versions |= {name: plugins.load("guard.backends", name).versions() for name in plan.backends}
    if not file.exists():
        if out.exists() and any(out.iterdir()):
            raise RunError(f"{out}: is not empty and holds no plan.json: choose another folder")
        write_json(file, {"format": PLAN_FORMAT, **plan.deciders(), "versions": versions})
        return
    found = read_json(file, "choose another folder")
    if found.get("format") != PLAN_FORMAT:
        raise RunError(f"{file}: format {found.get('format')!r} is not {PLAN_FORMAT!r}: choose another folder")
    known = found.pop("versions", {})
    expected = plan.deciders()
    differing = [name for name in expected | found if name != "format" and found.get(name) != expected.get(name)]
    if differing:
        name = differing[0]
        more = f" (and {', '.join(differing[1:])})" if differing[1:] else ""
        raise RunError(
            f"{out}: holds results with {name} = {found.get(name)!r}, not {expected.get(name)!r}{more}: "
            "choose another folder, or repeat the same options to go on"
        )
    for name, version in versions.items():
        if known.setdefault(name, version) != version:
            raise RunError(f"{out}: made with {name} {known[name]}, installed is {version}: choose another folder")
    write_json(file, {"format": PLAN_FORMAT, **expected, "versions": known})
