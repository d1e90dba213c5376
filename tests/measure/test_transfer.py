"""The transfer experiment: right numbers, nothing done twice, nothing mixed, everything resumable."""

from __future__ import annotations

import json
import shutil
import sys
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from guard_api.errors import RunError, SpecError
from guard_api.measure import training
from guard_api.measure.diagnosis import Finding
from guard_api.measure.plan import TransferPlan
from guard_api.measure.report import write_report
from guard_api.measure.transfer import Progress, run_transfer
from guard_api.model import library
from guard_api.runs import manifest
from tests.measure.conftest import EPOCHS, ToyConfig


def read(path: Path | None) -> dict:
    assert path is not None
    return json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def find(rows: list[dict], source: str, target: str) -> dict:
    return next(row for row in rows if (row["source"], row["target"]) == (source, target))


def test_the_matrix_says_what_the_toys_do(toy, make_plan, tmp_path: Path):
    result = read(run_transfer(make_plan(), tmp_path / "out"))
    assert len(result["cells"]) == 4 * 3
    assert len(result["transfers"]) == 6

    twin = find(result["transfers"], "exact", "twin")
    for gap in twin["gaps"].values():
        assert (gap["value"], gap["low"], gap["high"]) == (0.0, 0.0, 0.0)
    assert twin["retention"]["value"] == 1.0

    # a policy of the weak engine drives 1.3 times as far in the strong one
    stronger = find(result["transfers"], "exact", "strong")
    expected = [1.5 * (1 + 0.02 * seed) for seed in (0, 1, 2)]
    np.testing.assert_allclose(find(result["cells"], "exact", "exact")["estimates"]["return"]["per_seed"], expected)
    np.testing.assert_allclose(stronger["gaps"]["return"]["value"], 0.3 * np.mean(expected))
    assert stronger["gaps"]["cost"]["low"] > 0.0
    assert stronger["safe"]["both"] + stronger["safe"]["source_only"] + stronger["safe"]["neither"] == 3

    assert result["cost_limit"] == 1.0
    assert find(result["cells"], "random", "exact")["verdict"] == "safe"
    assert find(result["cells"], "exact", "strong")["verdict"] == "unsafe"
    assert [len(run["rows"]) for run in result["training"]] == [EPOCHS] * 9
    assert result["manifest"]["engines"]["strong"] == {"strong": "1.0"}
    assert result["manifest"]["approximations"]["strong"] == ["strong is a toy"]
    episodes = find(result["cells"], "exact", "strong")["runs"][2]["episodes"]
    assert episodes["seed"] == 1_000_002
    assert len(episodes["returns"]) == 12
    assert all(env.closed for env in toy.environments)


def test_a_second_call_does_nothing_twice_and_says_the_same(toy, make_plan, tmp_path: Path, monkeypatch):
    first = read(run_transfer(make_plan(), tmp_path))
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json") if path.parent.name == "cells"}
    toy.algorithm.log.clear()
    toy.environments.clear()
    monkeypatch.setattr(manifest, "git_state", lambda folder: {"commit": "later", "dirty": True})
    monkeypatch.setattr(sys, "argv", ["guard", "later"])
    second = read(run_transfer(make_plan(), tmp_path))
    assert not toy.algorithm.log
    assert not toy.environments
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert first == second  # who measured what, and when, included


def test_an_option_that_changes_no_number_may_change(toy, make_plan, tmp_path: Path):
    first = read(run_transfer(make_plan(), tmp_path))
    again = read(run_transfer(make_plan(config=ToyConfig(haste=2)), tmp_path))
    assert first["cells"] == again["cells"]


def test_seeds_and_backends_may_be_added(toy, make_plan, tmp_path: Path):
    run_transfer(make_plan(seeds=(0, 1), backends=("exact",)), tmp_path)
    toy.algorithm.log.clear()
    result = read(run_transfer(make_plan(), tmp_path))
    assert len(toy.algorithm.log) == EPOCHS * 7
    assert result == read(run_transfer(make_plan(), tmp_path))


def test_every_commit_that_measured_something_is_named(toy, make_plan, tmp_path: Path, monkeypatch):
    states = [{"commit": name, "dirty": False} for name in ("first", "second")]
    result = {}
    for count, state in enumerate(states, start=1):
        now = datetime(2030, 1, count, tzinfo=UTC)
        monkeypatch.setattr(manifest, "git_state", lambda folder, state=state: state)
        monkeypatch.setattr(manifest, "datetime", SimpleNamespace(now=lambda zone, now=now: now))
        result = read(run_transfer(make_plan(seeds=tuple(range(count))), tmp_path))
    assert result["manifest"]["commits"] == states
    assert (result["manifest"]["git"], result["manifest"]["started"][:10]) == (states[1], "2030-01-02")
    html = write_report(tmp_path).read_text()
    assert all(state["commit"] in html for state in states)


def test_stopping_at_any_point_and_going_on_gives_the_same_result(toy, make_plan, tmp_path: Path):
    whole = read(run_transfer(make_plan(), tmp_path / "whole"))
    toy.algorithm.log.clear()
    path, calls = None, 0
    while path is None:
        asked = 0

        def stop() -> bool:
            nonlocal asked
            asked += 1
            return asked >= 5

        path = run_transfer(make_plan(), tmp_path / "parts", should_stop=stop)
        calls += 1
        assert calls < 50
    assert calls > 5
    parts = read(path)
    assert len(toy.algorithm.log) == EPOCHS * 9  # no epoch was trained twice
    assert {**parts, "manifest": 0} == {**whole, "manifest": 0}


def test_a_crash_in_an_evaluation_keeps_the_finished_cells(toy, make_plan, tmp_path: Path, monkeypatch):
    real, cells = toy.algorithm.load_policy, []

    def crash(checkpoint):
        cells.append(checkpoint)
        if len(cells) == 4:
            raise KeyboardInterrupt
        return real(checkpoint)

    monkeypatch.setattr(toy.algorithm, "load_policy", crash)
    with pytest.raises(KeyboardInterrupt):
        run_transfer(make_plan(), tmp_path)
    assert all(env.closed for env in toy.environments)
    assert len(list((tmp_path / "cells").iterdir())) == 3
    assert not (tmp_path / "transfer.json").exists()
    assert run_transfer(make_plan(), tmp_path) is not None
    assert len(cells) == 28


def test_a_run_killed_before_its_first_checkpoint_starts_again(toy, make_plan, tmp_path: Path):
    plan = make_plan(seeds=(0,), backends=("exact",))
    run_transfer(plan, tmp_path)
    path = make_plan().training(tmp_path, "exact", 0).path
    (path / "finished.json").unlink()
    for checkpoint in (path / "checkpoints").iterdir():
        for file in checkpoint.iterdir():
            file.unlink()
        checkpoint.rmdir()
    toy.algorithm.log.clear()
    result = read(run_transfer(plan, tmp_path))
    assert [epoch for _, _, epoch in toy.algorithm.log] == [1, 2, 3, 4]
    assert len(result["training"][0]["rows"]) == EPOCHS


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"total_steps": 500}, r"total_steps = 400, not 500: choose another folder"),
        ({"config": ToyConfig(ambition=2.0)}, r"config\.ambition = 1\.5, not 2\.0"),
        ({"episodes": 13, "eval_worlds": 6}, r"episodes = 12, not 13 \(and eval_worlds\)"),
        ({"evaluation_seed": 77}, "evaluation_seed"),
    ],
)
def test_results_of_another_plan_are_not_mixed_in(toy, make_plan, tmp_path: Path, change, message):
    run_transfer(make_plan(seeds=(0,), backends=("exact",)), tmp_path)
    with pytest.raises(RunError, match=message):
        run_transfer(make_plan(**change), tmp_path)


def test_results_of_another_engine_version_are_not_mixed_in(toy, make_plan, tmp_path: Path):
    run_transfer(make_plan(), tmp_path)
    toy.versions["strong"] = "2.0"
    with pytest.raises(RunError, match=r"strong.*1\.0.*2\.0"):
        run_transfer(make_plan(), tmp_path)
    assert run_transfer(make_plan(backends=("exact", "twin")), tmp_path) is not None


@pytest.fixture
def side_file(tmp_path: Path, monkeypatch) -> Path:
    """A file of the robot, which may be edited."""
    root = tmp_path / "robots"
    shutil.copytree(library.shipped_root(), root)
    monkeypatch.setattr(library, "shipped_root", lambda: root)
    return root / "urdf/point/robot.toml"


def test_results_of_an_edited_robot_are_not_mixed_in(toy, make_plan, tmp_path: Path, side_file: Path):
    run_transfer(make_plan(), tmp_path / "out")
    side_file.write_text(side_file.read_text() + "\n")
    with pytest.raises(RunError, match=r"assets\.robot\.toml"):
        run_transfer(make_plan(), tmp_path / "out")


def test_a_robot_edited_while_it_is_measured_is_noticed(toy, make_plan, tmp_path: Path, side_file: Path):
    def edit(progress: Progress) -> None:
        if progress.stage == "evaluate" and progress.done == 1:
            side_file.write_text(side_file.read_text() + "\n")

    with pytest.raises(RunError, match=r"assets\.robot\.toml"):
        run_transfer(make_plan(), tmp_path / "out", report=edit)
    assert not (tmp_path / "out" / "transfer.json").exists()


def test_a_foreign_folder_is_left_alone(toy, make_plan, tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(RunError, match="not empty"):
        run_transfer(make_plan(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_damaged_cell_names_its_file(toy, make_plan, tmp_path: Path):
    run_transfer(make_plan(), tmp_path)
    cell = next((tmp_path / "cells").iterdir())
    cell.write_text(cell.read_text()[:100])
    with pytest.raises(RunError, match=rf"{cell.name}.*delete this file"):
        run_transfer(make_plan(), tmp_path)


def test_one_backend_or_one_seed_is_a_small_matrix(toy, make_plan, tmp_path: Path):
    result = read(run_transfer(make_plan(backends=("exact",), seeds=(3,)), tmp_path))
    assert result["transfers"] == []
    estimate = find(result["cells"], "exact", "exact")["estimates"]["return"]
    assert estimate["low"] is None
    assert estimate["reason"] == "no interval below 3 seeds"


def test_training_in_one_backend_gives_one_row(toy, make_plan, tmp_path: Path):
    out = run_transfer(make_plan(train_on=("twin",)), tmp_path)
    result = read(out)
    assert {(cell["source"], cell["target"]) for cell in result["cells"]} == {
        (source, target) for source in ("twin", "random") for target in ("exact", "twin", "strong")
    }
    assert [(t["source"], t["target"]) for t in result["transfers"]] == [("twin", "exact"), ("twin", "strong")]
    assert {backend for backend, _, _ in toy.algorithm.log} == {"twin"}
    assert write_report(tmp_path).exists()
    # Further rows may be added later; what is there is kept.
    again = read(run_transfer(make_plan(), tmp_path))
    assert find(again["cells"], "twin", "strong") == find(result["cells"], "twin", "strong")


def test_progress_counts_up(toy, make_plan, tmp_path: Path):
    seen: list[Progress] = []
    run_transfer(make_plan(), tmp_path, report=seen.append)
    cells = [progress.done for progress in seen if progress.stage == "evaluate"]
    assert cells == list(range(1, 37))
    epochs = [progress for progress in seen if progress.stage == "train"]
    assert len(epochs) == EPOCHS * 9
    assert [progress.done for progress in epochs] == [count // EPOCHS for count in range(1, EPOCHS * 9 + 1)]


@pytest.mark.parametrize(
    "change",
    [
        {"seeds": ()},
        {"seeds": (1, 1)},
        {"backends": ()},
        {"episodes": 0},
        {"seeds": (-1,)},
        {"train_on": ("mars",)},
        {"evaluation_seed": 1},
        {"train_on": ("exact", "exact")},
        {"train_on": ("elsewhere",)},
    ],
)
def test_plans_that_mean_nothing_are_refused(make_plan, change):
    with pytest.raises(SpecError):
        make_plan(**change)


def test_the_limit_is_the_algorithms_unless_given(make_plan):
    plan: TransferPlan = make_plan()
    assert plan.limit == 1.0
    assert make_plan(cost_limit=7.0).limit == 7.0
    assert make_plan(cost_limit=7.0).fingerprint == plan.fingerprint  # verdicts may change without measuring again


def test_what_goes_wrong_in_a_training_is_told_when_it_does(toy, make_plan, tmp_path: Path, monkeypatch):
    finding = Finding(epoch=EPOCHS, kind="policy-stuck", message="it does not move", remedy="push it")
    monkeypatch.setattr(training, "diagnose", lambda rows, **rest: [finding] if len(rows) == EPOCHS else [])
    told = []
    plan = make_plan(seeds=(0, 1))
    run_transfer(plan, tmp_path, warned=lambda one, what: told.append((one.backend, one.seed, what)))
    assert told == [(backend, seed, finding) for backend in plan.backends for seed in (0, 1)]
