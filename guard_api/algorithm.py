"""The seam between GUARD and a learning algorithm: what a plugin of group `guard.algorithms` provides.

An algorithm trains a policy in a batched environment, writing to a run directory, and loads the policy back. It sees
observations, rewards and named costs; never a simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from guard_api.env import Environment
    from guard_api.runs.directory import RunDirectory


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
    resume: continue from the last checkpoint of `run`. report: called after every epoch with its metrics row.
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
