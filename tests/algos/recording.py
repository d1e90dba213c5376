"""A training with everything kept that its log speaks of: batches, parameters before and after, steps tried."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import Tensor

from guard_algos import trust_region
from guard_algos.batch import Batch
from guard_algos.checkpoint import read
from guard_api.runs import directory
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import train

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Epoch:
    """One epoch of a training.

    row: what it logged. batch: what it learned from. before, after: the checkpoints around it. step: (P,), the whole
    step of the policy, before the line search. solves: (A x = b) of conjugate gradient, as pairs (b, x).
    """

    row: dict[str, float]
    batch: Batch
    before: Arrays
    after: Arrays
    step: np.ndarray
    solves: list[tuple[np.ndarray, np.ndarray]]


def record(algorithm: Any, env: Any, folder: Path, config: Any, total_steps: int) -> list[Epoch]:
    """Train, leaving a checkpoint after every epoch (`checkpoint_every=1`); return all epochs but the first."""
    batches: list[Batch] = []
    steps: list[np.ndarray] = []
    solves: list[list[tuple[np.ndarray, np.ndarray]]] = []
    improve, search, solve = algorithm.method.improve, trust_region._line_search, trust_region.conjugate_gradient

    def improved(self: Any, policy: Any, theta: Tensor, batch: Batch, pool: Any) -> dict[str, float]:
        batches.append(batch)
        solves.append([])
        return improve(self, policy, theta, batch, pool)

    def searched(theta: Tensor, delta: Tensor, **rest: Any) -> Any:
        steps.append(delta.double().numpy().copy())
        return search(theta, delta, **rest)

    def solved(product: Any, b: Tensor, **rest: Any) -> Any:
        solution = solve(product, b, **rest)
        solves[-1].append((b.double().numpy().copy(), solution.x.double().numpy().copy()))
        return solution

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(algorithm.method, "improve", improved)
        patch.setattr(trust_region, "_line_search", searched)
        patch.setattr(trust_region, "conjugate_gradient", solved)
        patch.setattr(directory, "KEPT_CHECKPOINTS", 1000)
        assert train(algorithm, env, folder, config, total_steps)
    run = RunDirectory.open(folder)
    saved = [read(path, algorithm.name)[0] for path in run.checkpoints()]
    epochs = zip(run.rows(), batches, [{}, *saved[:-1]], saved, steps, solves, strict=True)
    names = ("row", "batch", "before", "after", "step", "solves")
    return [Epoch(**dict(zip(names, epoch, strict=True))) for epoch in epochs][1:]
