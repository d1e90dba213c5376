"""Run directories: nothing is lost, nothing torn is believed, nothing foreign is opened."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from guard_api.errors import RunError
from guard_api.runs import atomic
from guard_api.runs.checkpoint import STATE_FILE, TENSORS_FILE, load_checkpoint, save_checkpoint
from guard_api.runs.directory import KEPT_CHECKPOINTS, RunDirectory

TENSORS = {"weight": np.arange(6, dtype=np.float32).reshape(2, 3), "rng": np.array([1, 2**63], dtype=np.uint64)}
STATE = {"epoch": 3, "lr": 0.1, "generator": {"state": 2**100}}


@pytest.fixture
def run(tmp_path: Path):
    run = RunDirectory.create(tmp_path / "run", manifest={"seed": 0}, config={"gamma": 0.99})
    yield run
    run.close()


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch):
    def refuse(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)


def test_create_then_open_returns_what_was_given(run: RunDirectory):
    again = RunDirectory.open(run.path)
    assert again.manifest["seed"] == 0
    assert again.config == {"gamma": 0.99}


def test_create_refuses_a_folder_in_use_and_accepts_an_empty_one(tmp_path: Path):
    (tmp_path / "empty").mkdir()
    RunDirectory.create(tmp_path / "empty", manifest={}, config={})
    with pytest.raises(RunError, match=r"not empty.*--resume"):
        RunDirectory.create(tmp_path / "empty", manifest={}, config={})


def test_open_refuses_missing_foreign_and_corrupt(tmp_path: Path):
    with pytest.raises(RunError, match="no such run directory"):
        RunDirectory.open(tmp_path / "none")
    (tmp_path / "foreign").mkdir()
    with pytest.raises(RunError, match=r"no manifest\.json"):
        RunDirectory.open(tmp_path / "foreign")
    for text, message in [("{", "not valid JSON"), ("[]", "not an object"), ('{"format": "x"}', "'x' is not")]:
        (tmp_path / "foreign" / "manifest.json").write_text(text)
        with pytest.raises(RunError, match=message):
            RunDirectory.open(tmp_path / "foreign")


def test_rows_come_back_to_the_bit(run: RunDirectory):
    rows = [
        {"epoch": 1, "total_steps": 30000, "return": 0.1 + 0.2, "cost": 1e-300},
        {"epoch": 2, "total_steps": 60000, "return": float("inf"), "cost": -7.25, "late_column": 1 / 3},
    ]
    for row in rows:
        run.log(row)
    assert run.rows() == rows
    assert RunDirectory.open(run.path).rows() == rows


def test_a_row_needs_its_indices(run: RunDirectory):
    with pytest.raises(ValueError, match="total_steps"):
        run.log({"epoch": 1, "return": 2.0})


@pytest.mark.parametrize("cut", range(1, 12))
def test_a_torn_last_line_is_dropped_on_open(run: RunDirectory, cut: int):
    run.log({"epoch": 1, "total_steps": 10, "return": 1.5})
    run.log({"epoch": 2, "total_steps": 20, "return": 1234.5})
    file = run.path / "progress.csv"
    file.write_bytes(file.read_bytes()[:-cut])
    again = RunDirectory.open(run.path)
    assert [row["epoch"] for row in again.rows()] == [1]
    again.log({"epoch": 2, "total_steps": 20, "return": 3.0})
    again.close()
    assert again.rows()[1] == {"epoch": 2, "total_steps": 20, "return": 3.0}


def test_a_cell_that_is_no_number_names_its_line(run: RunDirectory):
    run.log({"epoch": 1, "total_steps": 10})
    with (run.path / "progress.csv").open("a") as file:
        file.write("2,many\n")
    with pytest.raises(RunError, match=r"progress\.csv:3"):
        run.rows()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"\xff\xfe,1\n", "cannot be read"),
        (b"1,2\n", r":3: epoch 1 after 1: repair or delete"),
        (b",2\n", r":3: no epoch"),
    ],
)
def test_a_damaged_log_is_told_in_one_line(run: RunDirectory, line: bytes, message: str):
    run.log({"epoch": 1, "total_steps": 100})
    log = run.path / "progress.csv"
    log.write_bytes(log.read_bytes() + line)
    with pytest.raises(RunError, match=message):
        run.rows()


@pytest.mark.parametrize("text", ["", "junk\n", "epoch,return\n1,2\n"])
def test_a_file_that_is_no_log_is_not_a_log_without_rows(run: RunDirectory, text: str):
    (run.path / "progress.csv").write_text(text)
    with pytest.raises(RunError, match=r"progress\.csv:1: has no column"):
        run.rows()


def test_truncate_log_drops_later_epochs(run: RunDirectory):
    for epoch in range(1, 6):
        run.log({"epoch": epoch, "total_steps": 10 * epoch, "return": float(epoch)})
    run.truncate_log(3)
    assert [row["epoch"] for row in run.rows()] == [1, 2, 3]
    run.log({"epoch": 4, "total_steps": 40, "return": 9.0})
    assert run.rows()[-1]["return"] == 9.0


def test_tensorboard_reads_the_events(run: RunDirectory):
    from tensorboardX.proto.event_pb2 import Event

    run.log({"epoch": 1, "total_steps": 10, "return": 1.5})
    run.truncate_log(0)
    run.log({"epoch": 1, "total_steps": 10, "return": 2.5})
    events = [Event.FromString(record) for record in tfrecords(next(run.path.glob("events.out.tfevents.*")))]
    values = [(event.step, value.tag, value.simple_value) for event in events for value in event.summary.value]
    assert values == [(10, "return", 1.5), (10, "return", 2.5)]
    assert [event.step for event in events if event.HasField("session_log")] == [0]


def tfrecords(path: Path) -> list[bytes]:
    data, records = path.read_bytes(), []
    while data:
        size = int.from_bytes(data[:8], "little")
        records.append(data[12 : 12 + size])
        data = data[12 + size + 4 :]
    return records


def test_checkpoints_round_trip_and_the_oldest_go(run: RunDirectory):
    for epoch in (1, 2, 10, 11, 12):
        run.save_checkpoint(epoch, TENSORS, {**STATE, "epoch": epoch})
    last = run.last_checkpoint()
    assert last == run.path / "checkpoints" / "000012"
    assert len(run.checkpoints()) == KEPT_CHECKPOINTS
    tensors, state = load_checkpoint(last)
    assert state == {**STATE, "epoch": 12}
    for name, array in TENSORS.items():
        assert tensors[name].dtype == array.dtype
        np.testing.assert_array_equal(tensors[name], array)


def test_last_checkpoint_of_a_new_run_is_none(run: RunDirectory):
    assert run.last_checkpoint() is None


def test_damage_to_any_byte_is_noticed(tmp_path: Path):
    for name in (TENSORS_FILE, STATE_FILE):
        save_checkpoint(tmp_path / "c", TENSORS, STATE)
        file = tmp_path / "c" / name
        data = file.read_bytes()
        for damaged in (data[:-3], data[: len(data) // 2], b"", data.replace(b"3", b"4")):
            if damaged == data:
                continue
            file.write_bytes(damaged)
            with pytest.raises(RunError, match=r"(tensors|state).*train again|not a checkpoint"):
                load_checkpoint(tmp_path / "c")
        file.unlink()
        with pytest.raises(RunError, match=name):
            load_checkpoint(tmp_path / "c")


def test_the_remedy_for_damage_names_the_checkpoint_before(run: RunDirectory):
    for epoch in (9, 10):
        path = run.save_checkpoint(epoch, TENSORS, STATE)
        (path / TENSORS_FILE).write_bytes(b"")
    with pytest.raises(RunError, match=r"delete the folder .*000010 and .* goes on from checkpoint 000009"):
        load_checkpoint(run.path / "checkpoints" / "000010")
    with pytest.raises(RunError, match="goes on from the start"):
        load_checkpoint(run.path / "checkpoints" / "000009")
    (run.save_best(TENSORS, STATE) / STATE_FILE).write_text("{")
    with pytest.raises(RunError, match="use another checkpoint"):
        load_checkpoint(run.path / "checkpoints" / "best")


def test_restart_and_delete_leave_the_files_of_the_user(run: RunDirectory):
    def leave_results(run: RunDirectory) -> None:
        run.log({"epoch": 1, "total_steps": 10})
        run.save_best(TENSORS, STATE)
        run.save_checkpoint(1, TENSORS, STATE)

    leave_results(run)
    (run.path / "notes.txt").write_text("mine")
    again = run.restart(manifest={"seed": 1}, config={"gamma": 0.5})
    assert {file.name for file in run.path.iterdir()} == {"notes.txt", "manifest.json", "config.json"}
    assert RunDirectory.open(run.path).manifest == again.manifest == {"format": "guard-run-1", "seed": 1}
    leave_results(again)
    again.delete()
    assert [file.name for file in run.path.iterdir()] == ["notes.txt"]
    (run.path / "notes.txt").unlink()
    RunDirectory.create(run.path, manifest={}, config={}).delete()
    assert not run.path.exists()


def test_a_foreign_checkpoint_is_refused(tmp_path: Path):
    with pytest.raises(RunError, match="no such checkpoint"):
        load_checkpoint(tmp_path / "none")
    (tmp_path / "state.json").write_text(json.dumps({"format": "other"}))
    with pytest.raises(RunError, match="not a checkpoint of this GUARD"):
        load_checkpoint(tmp_path)


def test_a_full_disk_loses_nothing(run: RunDirectory, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest):
    row = {"epoch": 1, "total_steps": 10, "return": 1.5}
    run.log(row)
    run.save_checkpoint(1, TENSORS, STATE)
    request.getfixturevalue("full_disk")
    for action in (
        lambda: run.log({**row, "epoch": 2}),
        lambda: run.log({**row, "epoch": 2, "new_column": 1.0}),
        lambda: run.save_checkpoint(2, TENSORS, STATE),
        lambda: atomic.write_json(run.path / "manifest.json", {}),
        lambda: RunDirectory.create(run.path.parent / "second", manifest={}, config={}),
    ):
        with pytest.raises(RunError, match=r"No space left on device.*free some space") as caught:
            action()
        assert "\n" not in str(caught.value)
    monkeypatch.undo()
    again = RunDirectory.open(run.path)
    assert again.rows() == [row]
    assert load_checkpoint(again.path / "checkpoints" / "000001")[1] == STATE
    assert not list(run.path.parent.rglob("*.tmp"))
    assert not (run.path.parent / "second").exists()


KILLED = """
import sys, numpy as np
from guard_api.runs.directory import RunDirectory
run = RunDirectory.open(sys.argv[1])
epoch = 0
while True:
    epoch += 1
    run.log({"epoch": epoch, "total_steps": 10 * epoch, "value": epoch / 7})
    run.save_checkpoint(epoch, {"x": np.full(2000, epoch, dtype=np.float64)}, {"epoch": epoch})
    print(epoch, flush=True)
"""


def test_a_kill_at_any_moment_leaves_a_readable_run(run: RunDirectory):
    for delay in (0.0, 0.007):
        process = subprocess.Popen([sys.executable, "-c", KILLED, str(run.path)], stdout=subprocess.PIPE)
        assert process.stdout is not None
        for _ in range(4):
            process.stdout.readline()
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        again = RunDirectory.open(run.path)
        rows = again.rows()
        last = again.last_checkpoint()
        assert last is not None
        tensors, state = load_checkpoint(last)
        assert state["epoch"] >= 4
        assert np.all(tensors["x"] == state["epoch"])
        assert all(row["value"] == row["epoch"] / 7 for row in rows)
        again.truncate_log(0)
        for checkpoint in again.checkpoints():
            for file in checkpoint.iterdir():
                file.unlink()
            checkpoint.rmdir()
