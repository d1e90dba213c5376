"""Early diagnosis: every rule fires on what it is for, once, and never on a healthy training."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from guard_api.measure.diagnosis import Finding, cost_limits, diagnose
from guard_api.runs.progress import read_rows

ROOT = Path(__file__).resolve().parents[2]
LIMITS = {"cost_mean": 2.0}


def healthy(count: int = 100) -> list[dict[str, float]]:
    """A training whose cost falls to its limit, with the noise of a real one."""
    rng = np.random.default_rng(0)
    epochs = np.arange(1, count + 1)
    noise = 1 + 0.15 * rng.standard_normal((2, count))
    return [
        {
            "epoch": float(k),
            "kl": 0.015,
            "line_search_steps": 2.0,
            "entropy": 1.8 - 0.02 * k,
            "cost_mean": float(1.5 + 10 * np.exp(-k / 20)) * noise[0, k - 1],
            "value_loss_after": float(0.02 + 0.1 * (1 - np.exp(-k))) * noise[1, k - 1],
        }
        for k in epochs
    ]


def found(rows: list[dict[str, float]], limits: dict[str, float] = LIMITS) -> list[tuple[int, str]]:
    return [(one.epoch, one.kind) for one in diagnose(rows, limits=limits, action_size=2)]


def change(first: int, last: int, **values: float) -> list[dict[str, float]]:
    return [{**row, **(values if first <= row["epoch"] <= last else {})} for row in healthy()]


def test_a_healthy_training_is_left_alone() -> None:
    assert found(healthy()) == []
    assert found([]) == []
    assert found([{"epoch": 1.0}]) == []  # of an algorithm that logs none of these


@pytest.mark.parametrize("backend", ["mujoco", "bullet", "sapien"])
def test_recorded_trainings_are_left_alone(backend: str) -> None:
    rows = read_rows(ROOT / "results" / "trpo_goal_point" / backend / "progress.csv")
    assert len(rows) > 30
    assert found(rows, {}) == []


def test_entropy_collapse_fires_when_the_actions_hardly_vary_and_not_before() -> None:
    def at(deviation: float) -> float:
        return 2 * (np.log(deviation) + 0.5 * np.log(2 * np.pi * np.e))

    assert found(change(30, 100, entropy=at(0.049))) == [(30, "entropy-collapse")]
    assert found(change(30, 100, entropy=at(0.051))) == []


def test_a_policy_is_stuck_after_five_still_epochs_in_a_row_and_again_when_it_comes_back() -> None:
    assert found(change(30, 33, kl=0.0)) == []
    assert found(change(30, 34, kl=0.0)) == [(34, "policy-stuck")]
    assert found(change(30, 60, kl=1e-5)) == [(34, "policy-stuck")]
    twice = [{**row, "kl": 0.0 if 10 <= row["epoch"] <= 20 or row["epoch"] >= 50 else 0.01} for row in healthy()]
    assert found(twice) == [(14, "policy-stuck"), (54, "policy-stuck")]


def test_a_limit_is_infeasible_when_the_cost_stays_far_above_it() -> None:
    rng = np.random.default_rng(1)
    cost = 8 * (1 + 0.05 * rng.standard_normal(100))
    flat = [{**row, "cost_mean": c} for row, c in zip(healthy(), cost, strict=True)]
    assert found(flat) == [(40, "limit-infeasible")]  # once, though the cost rises and falls by chance
    assert found(flat, {"cost_mean": 5.0}) == []  # above, but not far
    assert found(flat, {}) == []  # no limit
    assert found([{**row, "cost_mean": 8 * 0.99 ** row["epoch"] + 4} for row in flat[:60]]) == []  # still falling
    lower = [{**row, "cost_mean": row["cost_mean"] * (1.0 if row["epoch"] <= 50 else 0.6)} for row in flat]
    assert [kind for _, kind in found(lower)] == ["limit-infeasible"] * 2  # it fell after all, and stays again


@pytest.mark.parametrize("algorithm", ["cpo", "pcpo", "trpo-fac", "trpo-lagrangian"])
def test_limits_of_zero_are_told_to_be_out_of_reach_in_recorded_trainings(algorithm: str) -> None:
    """Early, and then again only where the cost has fallen by a fifth; IPO's limit of 2 was kept."""
    runs = sorted((ROOT / "results" / "eight_algorithms").glob(f"*_{algorithm}_mujoco_*"))
    told = [found(read_rows(run / "progress.csv"), {"cost_mean": 0.0}) for run in runs]
    assert all(1 <= len(one) <= 3 and one[0][0] <= 100 for one in told), told
    kept = read_rows(ROOT / "results" / "eight_algorithms" / "Goal_Point_8Hazards_trpo-ipo_mujoco_seed0/progress.csv")
    assert found(kept, {"cost_mean": 2.0}) == []


def test_a_value_loss_explodes_when_it_stays_ten_times_what_it_was() -> None:
    assert found(change(50, 100, value_loss_after=5.0)) == [(52, "value-loss-exploding")]
    assert found(change(50, 51, value_loss_after=5.0)) == []
    assert found(change(50, 100, value_loss_after=0.5)) == []
    costs = [{**row, "cost_value_cost_loss_after": 1.0 if row["epoch"] < 20 else 50.0} for row in healthy()]
    assert found(costs) == [(22, "value-loss-exploding")]


def test_every_finding_says_what_is_seen_and_what_to_do() -> None:
    (finding,) = diagnose(change(30, 34, kl=0.0), limits={}, action_size=2)
    assert isinstance(finding, Finding)
    assert str(finding).startswith("epoch 34: the policy has not moved for 5 epochs")
    assert "cg_damping" in finding.remedy


def test_limits_are_those_of_the_options() -> None:
    assert cost_limits(SimpleNamespace(cost_limit=3.0, cost_limits={})) == {"cost_mean": 3.0}
    assert cost_limits(SimpleNamespace(cost_limit=0.0, cost_limits={"hazards": 1})) == {"cost_hazards": 1.0}
    assert cost_limits(SimpleNamespace()) == {}
