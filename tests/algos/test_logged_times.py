"""The time columns of the log: what is timed, and that it adds up."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest

from guard_algos import on_policy, trpo
from tests.algos.bandit import train
from tests.algos.corridor import LENGTH, Corridor

WORLDS = 10
CONFIG = trpo.algorithm.config_type(steps_per_epoch=LENGTH * WORLDS, hidden=(4,), value_iterations=2, threads=1)


def test_time_of_the_rollout_and_of_the_update_are_apart_and_add_up_to_the_speed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a clock that moves by 1 s in a step of the environment, 100 s in the policy's update and 1000 s in a fit."""
    now = [0.0]
    monkeypatch.setattr(on_policy, "perf_counter", lambda: now[0])

    def taking(seconds: float, work: Any) -> Any:
        def timed(*args: Any, **kwargs: Any) -> Any:
            now[0] += seconds
            return work(*args, **kwargs)

        return timed

    monkeypatch.setattr(trpo.Trpo, "improve", taking(100.0, trpo.Trpo.improve))
    monkeypatch.setattr(on_policy.Critic, "fit", taking(1000.0, on_policy.Critic.fit))
    monkeypatch.setattr(Corridor, "step", taking(1.0, Corridor.step))
    rows: list[Any] = []
    train(trpo.algorithm, Corridor(WORLDS), tmp_path, CONFIG, 400, report=rows.append)
    for row in rows:
        assert (row["time_rollout"], row["time_update"]) == (LENGTH, 1100.0)
        assert row["steps_per_second"] == pytest.approx(LENGTH * WORLDS / (LENGTH + 1100.0))
    assert len(rows) == 2


def test_times_are_no_longer_than_the_epoch_took(tmp_path: Path) -> None:
    ticks = [perf_counter()]
    rows: list[Any] = []

    def report(row: Any) -> None:
        rows.append(row)
        ticks.append(perf_counter())

    train(trpo.algorithm, Corridor(WORLDS), tmp_path, CONFIG, 600, report=report)
    for row, took in zip(rows, np.diff(ticks), strict=True):
        assert row["time_rollout"] > 0 and row["time_update"] > 0
        assert row["time_rollout"] + row["time_update"] <= took
