"""The best policy's checkpoint: the rule, what is saved, and that an interruption changes nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from guard_algos import cpo, trpo
from guard_algos.best import Standing, standing
from guard_algos.checkpoint import read
from guard_algos.constraints import Constraint
from guard_algos.episodes import Episodes
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Bandit, train

SMALL = {"steps_per_epoch": 200, "hidden": (8,), "value_iterations": 3, "threads": 1, "checkpoint_every": 1}


def played(gained: float, *costs: float) -> Episodes:
    one = np.ones(2)
    return Episodes(
        returns=gained * one, costs=np.zeros((2, 0)), constrained_costs=np.outer(one, costs), successes=one, length=one
    )


def test_within_the_limits_the_return_decides_and_outside_the_cost() -> None:
    limits = [Constraint(name="a", limit=1.0, columns=(0,)), Constraint(name="b", limit=2.0, columns=(1,))]
    order = [played(9, 5, 5), played(1, 4, 1), played(2, 0.5, 2.5), played(-3, 1, 2), played(4, 0, 0)]
    standings = [standing(episodes, limits) for episodes in order]
    assert standings == sorted(standings)
    assert [one.within for one in standings] == [False, False, False, True, True]
    assert standing(played(9.0), []) == Standing(True, 9.0)


@pytest.mark.parametrize(("algorithm", "limit"), [(trpo, None), (cpo, 5.0), (cpo, 1000.0)])
def test_the_best_checkpoint_is_the_policy_that_played_the_best_epoch(tmp_path: Path, algorithm, limit) -> None:
    options = SMALL if limit is None else {**SMALL, "cost_limit": limit}
    config, env = algorithm.algorithm.config_type(**options), Bandit(10, 20, {"a": 1.0})
    run_path = tmp_path / "run"
    train(algorithm.algorithm, env, run_path, config, 1600)
    run = RunDirectory.open(run_path)
    rows = run.rows()
    inside = [row for row in rows if limit is None or row["cost_mean"] <= limit]
    best = max(inside, key=lambda r: r["return_mean"]) if inside else min(rows, key=lambda r: r["cost_mean"])
    path = run.best_checkpoint()
    assert path is not None
    arrays, state = read(path, algorithm.algorithm.name)
    assert state.epoch == best["epoch"]
    # A training that ends one epoch earlier leaves as its last policy the one that acts in the best epoch.
    if best["epoch"] > 1:
        steps = int(best["epoch"] - 1) * 200
        train(algorithm.algorithm, Bandit(10, 20, {"a": 1.0}), tmp_path / "short", config, steps)
        last = RunDirectory.open(tmp_path / "short").last_checkpoint()
        assert last is not None
        np.testing.assert_array_equal(arrays["policy"], read(last, algorithm.algorithm.name)[0]["policy"])
    algorithm.algorithm.load_policy(path)


def test_an_interruption_changes_nothing_about_the_best(tmp_path: Path) -> None:
    config = cpo.CpoConfig(**SMALL, cost_limit=8.0)
    train(cpo.algorithm, Bandit(10, 20, {"a": 1.0}), tmp_path / "whole", config, 1600)
    stops = iter([False, False, True])
    train(cpo.algorithm, Bandit(10, 20, {"a": 1.0}), tmp_path / "parts", config, 1600, should_stop=lambda: next(stops))
    train(cpo.algorithm, Bandit(10, 20, {"a": 1.0}), tmp_path / "parts", config, 1600, resume=True)
    (whole, one), (parts, other) = (
        read(tmp_path / name / "checkpoints" / "best", "cpo") for name in ("whole", "parts")
    )
    np.testing.assert_array_equal(whole["policy"], parts["policy"])
    assert one == other
