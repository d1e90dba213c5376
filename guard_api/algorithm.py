"""The seam between GUARD and a learning algorithm: what a plugin of group `guard.algorithms` provides.

An algorithm trains a policy in a batched environment, writing to a run directory, and loads the policy back. It sees
observations, rewards and named costs; never a simulator.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import PluginError, unknown_name

if TYPE_CHECKING:
    from guard_api.env import Environment
    from guard_api.runs.directory import RunDirectory

CHANGES_NO_NUMBER: Final = {"changes_no_number": True}
"""`metadata` of an option's field that decides how fast or how often something is done, and no result."""

ROW: Final = {
    "epoch": "its number, from 1",
    "total_steps": "environment steps so far, over all worlds",
    "return_mean": "of the episodes that finished in the epoch",
    "cost_mean": "their undiscounted cost, summed over the constraints",
    "cost_rate": "cost per step of the whole training so far",
    "violation_rate": "share of the epoch's steps with any cost",
    "success_mean": "goals achieved in an episode",
    "steps_per_second": "of the epoch, rollout and update",
}
"""Columns that every metrics row holds, because tables and curves read them; an algorithm adds its own."""


@runtime_checkable
class Policy(Protocol):
    """A trained policy: no state, no simulator."""

    def act(
        self,
        observation: NDArray[np.floating],
        deterministic: bool = True,
        costs: NDArray[np.floating] | None = None,
    ) -> NDArray[np.float64]:
        """Return actions (N, A) for observations (N, O): the mean action, or a sample when not deterministic.

        costs: (N, C) of the step before, 0 at an episode's start, for policies with a safety layer that measures them.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingJob:
    """One training, complete.

    env: the batched environment; run: where results go; config: an instance of the algorithm's `config_type`.
    total_steps: environment steps over all worlds, rounded up to whole epochs. seed: of network, sampling and layouts.
    resume: continue from the last checkpoint of `run`. report: called after every epoch with its metrics row (`ROW`).
    should_stop: asked after every epoch; when true the training leaves a checkpoint and returns.
    """

    env: Environment
    run: RunDirectory
    config: Any
    total_steps: int
    seed: int
    resume: bool = False
    report: Callable[[Mapping[str, float]], None] = field(default=lambda row: None)
    should_stop: Callable[[], bool] = field(default=lambda: False)


@runtime_checkable
class Algorithm(Protocol):
    """A learning algorithm plugin. `config_type` is a frozen dataclass whose fields are its command-line options."""

    name: str
    config_type: type

    def train(self, job: TrainingJob) -> bool:
        """Train until `total_steps`; return whether they were reached (False when `should_stop` ended it)."""
        ...

    def load_policy(self, checkpoint: Path) -> Policy:
        """Load the policy of one checkpoint. Raises RunError when it is corrupt or another algorithm's."""
        ...


def check_row(algorithm: str, row: Mapping[str, float]) -> None:
    """Raise PluginError for a metrics row that lacks columns of `ROW`."""
    missing = [name for name in ROW if name not in row]
    if missing:
        names = ", ".join(missing)
        raise PluginError(f"algorithm {algorithm}: its metrics rows lack {names}: log all of guard_api.algorithm.ROW")


def whole_episodes(steps: int, num_worlds: int, episode_length: int) -> int:
    """Return the fewest environment steps, `steps` at least, that are whole episodes of every world."""
    together = num_worlds * episode_length
    return math.ceil(steps / together) * together


def deciding_names(config: Any) -> list[str]:
    """Return the names of the options, of a dataclass or its type, that decide a training's numbers."""
    return [f.name for f in dataclasses.fields(config) if not CHANGES_NO_NUMBER.keys() <= f.metadata.keys()]


def deciding_options(config: Any) -> dict[str, Any]:
    """Return as JSON data the options, of a dataclass `config`, that decide a training's numbers."""
    return json.loads(json.dumps({name: getattr(config, name) for name in deciding_names(config)}))


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """Settings known by a name: those of the training, and `options` of the algorithm's config.

    A plugin may have an attribute `presets`, name -> Preset.
    """

    total_steps: int
    num_worlds: int
    options: Mapping[str, Any]

    def changed(self, *, total_steps: int, num_worlds: int, config: Any) -> list[str]:
        """Return what of these settings is not the preset's, among all that decides a training's numbers."""
        preset = deciding_options(type(config)(**self.options)) | _size(self.total_steps, self.num_worlds)
        given = deciding_options(config) | _size(total_steps, num_worlds)
        return [name for name in given if given[name] != preset[name]]


def find_preset(algorithm: Algorithm, name: str) -> Preset:
    """Return a preset of `algorithm`. Raises SpecError, with the names there are, for any other."""
    presets: Mapping[str, Preset] = getattr(algorithm, "presets", {})
    if name not in presets:
        raise unknown_name(f"preset of {algorithm.name}", name, presets)
    return presets[name]


def _size(total_steps: int, num_worlds: int) -> dict[str, int]:
    return {"total_steps": total_steps, "num_worlds": num_worlds}
