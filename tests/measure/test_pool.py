"""The pool of trainings: adoption, skipping, going on, and failures that stay alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from guard_api.errors import RunError, SpecError
from guard_api.measure import training as module
from guard_api.measure.pool import train_all
from guard_api.measure.training import Training, is_trained
from guard_api.runs.directory import RunDirectory
from tests.measure.conftest import EPOCHS, SPEC, ToyConfig


def make(out: Path, seed: int = 0, **changes) -> Training:
    values = {"path": out / f"seed{seed}", "spec": SPEC, "backend": "exact", "algorithm": "toy", "config": ToyConfig(),
              "seed": seed, "total_steps": 400, "num_worlds": 2}  # fmt: skip
    return Training(**{**values, **changes})


def never() -> bool:
    return False


def test_rows_arrive_with_their_training_and_finished_ones_are_not_opened_again(toy, tmp_path: Path):
    trainings = [make(tmp_path, seed) for seed in (0, 1)]
    rows = []
    assert train_all(trainings, lambda training, row: rows.append((training.seed, row["epoch"])), never)
    assert rows == [(seed, epoch) for seed in (0, 1) for epoch in range(1, EPOCHS + 1)]
    toy.environments.clear()
    assert train_all(trainings, lambda *_: pytest.fail("trained twice"), never)
    assert not toy.environments


def test_more_steps_than_a_finished_run_has_go_on_from_its_checkpoint(toy, tmp_path: Path):
    short = make(tmp_path)
    assert train_all([short], lambda *_: None, never)
    longer = make(tmp_path, total_steps=500)
    assert is_trained(short)
    assert not is_trained(longer)
    toy.algorithm.log.clear()
    assert train_all([longer], lambda *_: None, never)
    assert is_trained(longer)
    assert not toy.algorithm.log  # the toy has no more epochs; a fresh run would have trained all of them


def test_a_failure_stays_alone_where_someone_listens_and_is_raised_where_no_one_does(toy, tmp_path: Path, monkeypatch):
    real = module.make_environment

    def broken(spec, *, seed=0, **rest):
        if seed == 1:
            raise RuntimeError("no such wheel")
        return real(spec, seed=seed, **rest)

    monkeypatch.setattr(module, "make_environment", broken)
    trainings, failures = [make(tmp_path, seed) for seed in (0, 1, 2)], []
    assert not train_all(trainings, lambda *_: None, never, failed=lambda t, e: failures.append((t.seed, str(e))))
    assert failures == [(1, "no such wheel")]
    assert [is_trained(training) for training in trainings] == [True, False, True]
    with pytest.raises(RuntimeError, match="wheel"):
        train_all(trainings, lambda *_: None, never)
    monkeypatch.setattr(module, "make_environment", real)
    assert train_all(trainings, lambda *_: None, never)


def test_a_stop_ends_all_and_the_same_call_goes_on(toy, tmp_path: Path):
    trainings = [make(tmp_path, seed) for seed in (0, 1)]
    assert not train_all(trainings, lambda *_: None, lambda: True)
    assert len(toy.algorithm.log) == 1
    assert train_all(trainings, lambda *_: None, never)
    assert len(toy.algorithm.log) == 2 * EPOCHS


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"config": ToyConfig(ambition=2.0)}, "--ambition 1.5, not 2.0"),
        ({"num_worlds": 3}, "--num-worlds 2, not 3"),
        ({"seed": 7, "path": "seed0"}, "--seed 0, not 7"),
        ({"spec": replace(SPEC, name="Push_Toy")}, "--env Goal_Toy_0Hazards, not Push_Toy"),
        ({"spec": replace(SPEC, episode_length=30)}, "another specification of --env Goal_Toy_0Hazards"),
    ],
)
def test_the_run_of_another_training_is_refused(toy, tmp_path: Path, changes, words: str):
    assert not train_all([make(tmp_path)], lambda *_: None, lambda: True)
    changes = {**changes, "path": tmp_path / "seed0"}
    with pytest.raises(RunError, match=words):
        train_all([make(tmp_path, **changes)], lambda *_: None, never)


def test_a_run_directory_without_the_mark_is_adopted(toy, tmp_path: Path):
    training = make(tmp_path)
    assert train_all([training], lambda *_: None, never)
    (training.path / module.FINISHED).unlink()  # as a run that was made before there was one
    toy.algorithm.log.clear()
    assert train_all([training], lambda *_: None, never)
    assert not toy.algorithm.log
    assert json.loads((training.path / module.FINISHED).read_text()) == {"checkpoint": "000004", "total_steps": 400}


def test_a_run_without_a_checkpoint_begins_anew_and_the_user_s_files_stay(toy, tmp_path: Path):
    training = make(tmp_path)
    RunDirectory.create(training.path, manifest={"seed": 5}, config={}).close()
    (training.path / "notes.txt").write_text("mine")
    (training.path / module.DIAGNOSIS).write_text("{}")
    assert train_all([training], lambda *_: None, never)
    assert (training.path / "notes.txt").read_text() == "mine"
    assert RunDirectory.open(training.path).manifest["seed"] == 0
    assert not (training.path / module.DIAGNOSIS).exists()


def refuse(job) -> bool:
    raise SpecError("set a limit above 0")


def test_a_training_that_never_began_leaves_nothing(toy, tmp_path: Path, monkeypatch):
    training = make(tmp_path)
    monkeypatch.setattr(toy.algorithm, "train", refuse)
    with pytest.raises(SpecError, match="limit"):
        train_all([training], lambda *_: None, never)
    assert not training.path.exists()


def test_one_that_began_keeps_its_run_when_it_fails(toy, tmp_path: Path, monkeypatch):
    training = make(tmp_path)
    assert not train_all([training], lambda *_: None, lambda: True)
    monkeypatch.setattr(toy.algorithm, "train", refuse)
    with pytest.raises(SpecError, match="limit"):
        train_all([training], lambda *_: None, never)
    assert RunDirectory.open(training.path).last_checkpoint() is not None


def test_a_folder_that_was_there_stays_a_run_when_the_training_is_refused(toy, tmp_path: Path, monkeypatch):
    training = make(tmp_path)
    RunDirectory.create(training.path, manifest={}, config={}).close()
    (training.path / "notes.txt").write_text("mine")
    monkeypatch.setattr(toy.algorithm, "train", refuse)
    with pytest.raises(SpecError, match="limit"):
        train_all([training], lambda *_: None, never)
    assert {file.name for file in training.path.iterdir()} == {"notes.txt", "manifest.json", "config.json"}
