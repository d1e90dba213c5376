"""The pool with real processes: one is killed, all are stopped, and the same call goes on to the same bits."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path

import pytest

from guard_api.errors import RunError
from guard_api.measure.grid import Grid
from guard_api.measure.pool import train_all
from guard_api.measure.training import Training, findings, is_trained
from guard_api.runs.directory import RunDirectory

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="finds the process of a training in /proc"),
]
EPOCHS = 30
TIMES = {"time_rollout", "time_update", "steps_per_second"}


def trainings(out: Path) -> list[Training]:
    """Two seeds of a policy that hardly explores, which is diagnosed in its first epoch."""
    options = {"steps_per_epoch": 20, "value_iterations": 1, "checkpoint_every": 1, "threads": 1,
               "initial_log_std": -4.0}  # fmt: skip
    long = Grid(
        envs=("Goal_Point_8Hazards",), algos=("trpo",), backends=("ideal",), seeds=(0, 1), total_steps=20 * EPOCHS,
        num_worlds=1, options=options,
    ).trainings(out)  # fmt: skip
    return [replace(training, spec=replace(training.spec, episode_length=20)) for training in long]


def process_of(training: Training) -> int:
    """Return the id of the child that has a file in the run directory open."""
    for child in active_children():
        files = Path(f"/proc/{child.pid}/fd").iterdir()
        if any(os.path.realpath(file).startswith(str(training.path.resolve())) for file in files):
            assert child.pid is not None
            return child.pid
    raise AssertionError(f"no process works on {training.path}")


def numbers(training: Training) -> list[dict[str, float]]:
    rows = RunDirectory.open(training.path).rows()
    return [{name: value for name, value in row.items() if name not in TIMES} for row in rows]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Training]:
    """The same trainings without any interruption, in this process."""
    done = trainings(tmp_path_factory.mktemp("whole"))
    assert train_all(done, lambda *_: None, lambda: False)
    return done


def test_a_killed_process_fails_alone_and_its_training_goes_on_to_the_same_bits(
    tmp_path: Path, whole: list[Training]
) -> None:
    victim, other = trainings(tmp_path)
    failures, warnings, rows = [], [], []

    def report(training: Training, row) -> None:
        rows.append((training.seed, row["epoch"]))
        if training == victim and row["epoch"] == 1:
            os.kill(process_of(victim), signal.SIGKILL)

    listeners = {
        "failed": lambda training, error: failures.append((training, error)),
        "warned": lambda training, finding: warnings.append((training.seed, finding.epoch, finding.kind)),
    }
    assert not train_all([victim, other], report, lambda: False, jobs=2, **listeners)
    ((training, error),) = failures
    assert training == victim and isinstance(error, RunError)
    assert f"{victim.path}: its training process died: run the same command again" in str(error)
    assert not is_trained(victim) and is_trained(other)
    assert [epoch for seed, epoch in rows if seed == other.seed] == list(range(1, EPOCHS + 1))
    assert sorted(warnings) == [(0, 1, "entropy-collapse"), (1, 1, "entropy-collapse")]
    assert not active_children()

    rows.clear()
    assert train_all([victim, other], lambda t, row: rows.append((t.seed, row["epoch"])), lambda: False, jobs=2)
    assert {seed for seed, _ in rows} == {victim.seed}  # the finished one is taken as it is
    assert rows[-1] == (victim.seed, EPOCHS)
    for mine, reference in zip((victim, other), whole, strict=True):
        assert numbers(mine) == numbers(reference)
        assert findings(mine) == findings(reference) != []


def test_a_stop_lets_every_process_leave_a_checkpoint(tmp_path: Path, whole: list[Training]) -> None:
    mine, seen = trainings(tmp_path), set()
    stop = lambda: len(seen) == 2  # noqa: E731
    assert not train_all(mine, lambda training, row: seen.add(training.seed), stop, jobs=2)
    stopped = [len(numbers(training)) for training in mine]
    assert all(1 <= count < EPOCHS for count in stopped)
    for training, count in zip(mine, stopped, strict=True):
        last = RunDirectory.open(training.path).last_checkpoint()
        assert last is not None and int(last.name) == count
    assert train_all(mine, lambda *_: None, lambda: False, jobs=2)
    assert [numbers(training) for training in mine] == [numbers(training) for training in whole]


def test_a_process_that_is_told_to_end_leaves_a_checkpoint_and_is_no_finished_training(tmp_path: Path) -> None:
    told, other = trainings(tmp_path)
    failures = []

    def report(training: Training, row) -> None:
        if training == told and row["epoch"] == 1:
            os.kill(process_of(told), signal.SIGTERM)

    caught = lambda training, error: failures.append(str(error))  # noqa: E731
    assert not train_all([told, other], report, lambda: False, jobs=2, failed=caught)
    assert failures == [
        f"{told.path}: its training process was told to end, and left a checkpoint: run the same command again to go on"
    ]
    last = RunDirectory.open(told.path).last_checkpoint()
    assert last is not None and int(last.name) == len(numbers(told)) < EPOCHS
    assert not is_trained(told) and is_trained(other)
