"""The `guard` command as a user types it: what works, and one clear line for what does not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from guard_api.cli.main import COMMANDS, run

ENV = "Goal_Point_8Hazards"
TINY = ["--num-worlds", "2", "--steps-per-epoch", "2000", "--value-iterations", "2"]


def train_arguments(out: Path, steps: int = 2000, algo: str = "trpo") -> list[str]:
    return ["train", "--env", ENV, "--algo", algo, "--backend", "mujoco", "--total-steps", str(steps), *TINY,
            "--out", str(out)]  # fmt: skip


def guard(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Run a command in this process; return its exit code, output and error output."""
    capsys.readouterr()
    try:
        code = run(arguments)
    except SystemExit as exit_:
        code = int(exit_.code or 0)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained") / "run"
    assert run([*train_arguments(out), "--json"]) == 0
    return out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard([command, "--help"], capsys)
    assert code == 0
    assert f"guard {command}" in out


def test_usage_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard([], capsys)
    assert code == 0
    assert all(command in out for command in COMMANDS)


@pytest.mark.parametrize("kind", ["envs", "robots", "tasks", "constraints", "algos", "backends"])
def test_list(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard(["list", kind, "--json"], capsys)
    assert code == 0
    assert all("name" in row for row in json.loads(out))
    code, table, _ = guard(["list", kind], capsys)
    assert code == 0
    assert json.loads(out)[0]["name"] in table


def test_train_leaves_a_run_directory(trained: Path) -> None:
    manifest = json.loads((trained / "manifest.json").read_text())
    assert manifest["env"] == ENV
    assert manifest["algorithm"] == "trpo"
    assert manifest["versions"]
    assert json.loads((trained / "config.json").read_text())["value_iterations"] == 2
    assert len((trained / "progress.csv").read_text().splitlines()) == 2
    assert list((trained / "checkpoints").iterdir())
    assert list(trained.rglob("*tfevents*"))


def test_eval_says_the_same_twice(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard(["eval", str(trained), "--backend", "mujoco", "--episodes", "2", "--json"], capsys)
    assert code == 0
    table = json.loads(out)
    assert len(table["returns"]) == 2
    code, again, _ = guard(["eval", str(trained), "--backend", "mujoco", "--episodes", "2", "--json"], capsys)
    assert again == out


def test_resume_goes_on_to_the_same_bits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    guard([*train_arguments(whole, 6000), "--json"], capsys)
    guard([*train_arguments(parts, 2000), "--json"], capsys)
    code, _, _ = guard([*train_arguments(parts, 6000), "--resume", "--json"], capsys)
    assert code == 0
    ends = [(out / "checkpoints" / "000003" / "tensors.safetensors").read_bytes() for out in (whole, parts)]
    assert ends[0] == ends[1]


def test_conform_prints_and_judges(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard(["conform", "--backend", "ideal", "--clause", "C1", "--json"], capsys)
    assert code == 0
    assert json.loads(out)["passed"]


def test_bench(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "--env", ENV, "--backend", "ideal", "--num-worlds", "2", "--seconds", "0.2", "--json"]
    code, out, _ = guard(arguments, capsys)
    assert code == 0
    assert json.loads(out)["efficiency"] > 0


def test_doctor_steps_every_backend(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard(["doctor", "--json"], capsys)
    assert code == 0
    assert {"backend ideal", "algorithm trpo"} <= {row["what"] for row in json.loads(out)}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["trian"], ["unknown command", "train"]),
        (["train", "--env", "Goal_Piont_8Hazards", "--out", "x"], ["Goal_Piont_8Hazards", "point"]),
        (["train", "--env", ENV, "--out", "x", "--backend", "mujocco"], ["mujocco", "mujoco"]),
        (["train", "--env", ENV, "--out", "x", "--algo", "tpro"], ["tpro", "trpo"]),
        (["train", "--env", ENV, "--out", "x", "--total-steps", "0"], ["total", "at least 1"]),
        (["train", "--env", ENV, "--out", "x", "--total-steps", "nan"], ["total", "nan"]),
        (["train", "--env", ENV, "--out", "x", "--seed", "-1"], ["seed is -1"]),
        (["train", "--env", ENV, "--out", "x", "--num-worlds", "0", "--backend", "ideal"], ["num_worlds", "0"]),
        (["train", "--env", ENV, "--out", "x", "--gamma", "1.5"], ["gamma", "1.5"]),
        (["train", "--env", ENV, "--out", "x", "--sede", "1"], ["--sede"]),
        (["eval", "/nonexistent/run"], ["/nonexistent/run"]),
        (["conform", "--backend", "ideal", "--clause", "C13"], ["C13"]),
        (["report", "/nonexistent/transfer"], ["/nonexistent/transfer"]),
        (["transfer", "--env", ENV, "--out", "x", "--seeds", "0", "0"], ["seeds"]),
    ],
    ids=lambda value: "_".join(value[:2]) if isinstance(value, list) else "",
)
def test_wrong_requests(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = guard(arguments, capsys)
    assert code == 2
    assert all(word in err for word in words), err
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir()), "a refused command must leave nothing behind"


def test_out_that_exists_is_not_overwritten(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = guard(train_arguments(trained), capsys)
    assert code == 2
    assert "--resume" in err


def test_resume_with_other_options_is_refused(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for change in (["--seed", "7"], ["--gamma", "0.9"]):
        code, _, err = guard([*train_arguments(trained), "--resume", *change], capsys)
        assert code == 2
        assert change[0].strip("-") in err


def test_foreign_and_damaged_directories(trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    code, _, err = guard(["eval", str(tmp_path)], capsys)
    assert code == 2
    assert "manifest.json" in err

    damaged = tmp_path / "damaged"
    subprocess.run(["cp", "-r", str(trained), str(damaged)], check=True)
    tensors = next(damaged.glob("checkpoints/0*/tensors.safetensors"))
    tensors.write_bytes(tensors.read_bytes()[:-20])
    code, _, err = guard(["eval", str(damaged), "--backend", "ideal"], capsys)
    assert code == 2
    assert "tensors.safetensors" in err

    manifest = json.loads((damaged / "manifest.json").read_text())
    (damaged / "manifest.json").write_text(json.dumps({"format": manifest["format"]}))
    for command in (
        ["eval"],
        ["export", "--out", str(tmp_path / "x.onnx")],
        ["report"],
        ["plot", "--out", str(tmp_path)],
    ):
        code, _, err = guard([command[0], str(damaged), *command[1:]], capsys)
        assert code == 2
        assert "manifest.json: has no " in err


def start(arguments: list[str], **kwargs) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "guard_api.cli", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **kwargs)


def wait_for_rows(out: Path, process: subprocess.Popen[str], rows: int) -> None:
    progress = out / "progress.csv"
    for _ in range(3600):
        if progress.exists() and len(progress.read_text().splitlines()) > rows:
            return
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.05)
    process.kill()
    raise AssertionError(f"no progress: {process.communicate()[1]}")


def test_interrupt_leaves_a_checkpoint_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run"
    process = start(train_arguments(out, 10_000_000))
    wait_for_rows(out, process, 1)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "checkpoint" in err
    epochs = len((out / "progress.csv").read_text().splitlines()) - 1
    assert (out / "checkpoints" / f"{epochs:06d}").is_dir()
    code, _, _ = guard([*train_arguments(out, (epochs + 1) * 2000), "--resume", "--json"], capsys)
    assert code == 0


def test_kill_loses_nothing_that_was_saved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run"
    process = start(train_arguments(out, 10_000_000))
    wait_for_rows(out, process, 2)
    process.kill()
    process.communicate(timeout=60)
    saved = max(int(path.name) for path in (out / "checkpoints").iterdir() if path.name.isdigit())
    steps = (saved + 1) * 2000
    code, _, err = guard([*train_arguments(out, steps), "--resume", "--json"], capsys)
    assert code == 0, err
    assert len((out / "progress.csv").read_text().splitlines()) - 1 == saved + 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs POSIX limits")
def test_no_room_on_the_disk_is_one_clear_line(tmp_path: Path) -> None:
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000)); "
        "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        f"from guard_api.cli.main import main; main({train_arguments(tmp_path / 'run')!r})"
    )
    result = subprocess.run([sys.executable, "-c", limited], capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert str(tmp_path) in result.stderr
    assert "Traceback" not in result.stderr
    assert not list((tmp_path / "run" / "checkpoints").glob("0*"))


def children(pid: int) -> list[int]:
    """Processes whose parent is `pid`."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it ended while we looked
            continue
        if int(fields[1]) == pid:
            found.append(int(stat.parent.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_a_killed_worker_is_one_clear_line_and_the_run_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pybullet")
    out = tmp_path / "run"
    arguments = ["train", "--env", ENV, "--backend", "bullet", *TINY, "--workers", "2", "--out", str(out)]
    process = start([*arguments, "--total-steps", "10_000_000"])
    wait_for_rows(out, process, 1)
    os.kill(children(process.pid)[0], signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "worker" in err
    assert "seed 0, epoch" in err
    assert f"guard train --resume --out {out}" in err.replace("\n", " ").replace("  ", " ")
    assert "Traceback" not in err
    saved = max(int(path.name) for path in (out / "checkpoints").iterdir() if path.name.isdigit())
    code, _, err = guard([*arguments, "--total-steps", str((saved + 1) * 2000), "--resume", "--json"], capsys)
    assert code == 0, err
    assert len((out / "progress.csv").read_text().splitlines()) - 1 == saved + 1
