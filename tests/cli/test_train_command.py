"""`guard train`: what it says of steps that are rounded up, of finished runs and of options that are refused."""

from __future__ import annotations

import json
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from guard_api.cli.main import run
from guard_api.runs.directory import RunDirectory

TRAIN = ["train", "--env", "Goal_Point_8Hazards", "--backend", "mujoco", "--num-worlds", "1", "--value-iterations", "1"]
EPOCH = ["--steps-per-epoch", "1000"]


def test_rounded_steps_and_a_finished_run_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [*TRAIN, *EPOCH, "--total-steps", "300", "--out", str(tmp_path / "run")]
    assert run([*arguments, "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["total_steps"] == 1000
    assert "trains 1,000 steps, not 300: rounded up to whole epochs of 1,000" in output.err
    assert "already trained" not in output.err
    assert run([*arguments, "--resume"]) == 0
    output = capsys.readouterr()
    assert "run: already trained for 1,000 steps" in output.out.replace("\n", "")
    assert "whole epochs" not in output.out


def test_epochs_of_other_world_counts_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [*TRAIN, "--num-worlds", "3", *EPOCH, "--total-steps", "3000", "--out", str(tmp_path / "run")]
    assert run([*arguments, "--json"]) == 0
    said = capsys.readouterr().err
    assert "an epoch is 3,000 steps, not 1,000: 3 whole episodes in 3 worlds" in said
    assert "rounded up" not in said


def test_the_remedy_for_a_damaged_last_checkpoint_works(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run"
    assert run([*TRAIN, *EPOCH, "--total-steps", "3000", "--out", str(out)]) == 0
    final = out / "checkpoints" / "000003"
    expected = (final / "tensors.safetensors").read_bytes()
    evaluate = ["eval", str(out), "--episodes", "1", "--json"]
    (final / "tensors.safetensors").write_bytes(expected + b"x")
    assert run(evaluate) == 2
    assert "delete the folder" in capsys.readouterr().err
    shutil.rmtree(final)
    assert run(evaluate) == 2  # not the policy before it
    assert "the final policy is gone" in capsys.readouterr().err.replace("\n", " ")
    assert run(["train", "--resume", "--out", str(out)]) == 0
    assert (final / "tensors.safetensors").read_bytes() == expected
    capsys.readouterr()
    assert run(evaluate) == 0
    assert json.loads(capsys.readouterr().out)["approximations"] == []


def test_a_refused_training_leaves_its_folder_free(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [*TRAIN, *EPOCH, "--algo", "trpo-ipo", "--total-steps", "1000", "--out", str(tmp_path / "run")]
    for wrong in (["--cost-limit", "0"], ["--cost-limits", "hazard", "1"]):
        assert run([*arguments, *wrong]) == 2
        assert "limit" in capsys.readouterr().err
        assert not list(tmp_path.iterdir())
    assert run([*arguments, "--cost-limit", "25", "--json"]) == 0
    assert "whole epochs" not in capsys.readouterr().err  # nothing is rounded


def test_other_options_are_refused_with_the_command_that_made_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [*TRAIN, *EPOCH, "--total-steps", "1000", "--out", str(tmp_path / "run")]
    monkeypatch.setattr(sys, "argv", ["guard", *arguments])
    assert run([*arguments, "--json"]) == 0
    for flag, value in (("--num-worlds", "2"), ("--gae-lambda", "0.5"), ("--algo", "cpo")):
        assert run([*arguments, flag, value, "--resume"]) == 2
        message = capsys.readouterr().err
        assert f"was made with {flag} " in message
        assert f"`{shlex.join(['guard', *arguments])}`" in message


def test_a_run_goes_on_with_its_own_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also with the steps that an earlier resumption set, which an interruption came before."""
    place = ["--out", str(tmp_path / "run")]
    limits = ["--algo", "cpo", "--cost-limit", "3", "--seed", "4"]
    assert run([*TRAIN, *EPOCH, *limits, "--total-steps", "1000", *place]) == 0
    assert run(["train", "--resume", *place, "--total-steps", "2000"]) == 0
    capsys.readouterr()
    config = json.loads((tmp_path / "run" / "config.json").read_text())
    assert (config["cost_limit"], config["value_iterations"]) == (3.0, 1)
    (tmp_path / "run" / "finished.json").unlink()
    shutil.rmtree(tmp_path / "run" / "checkpoints" / "000002")
    assert run(["train", "--resume", *place, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["total_steps"] == 2000
    assert run(["train", "--resume", *place]) == 0
    assert "already trained for 2,000 steps" in capsys.readouterr().out.replace("\n", "")


def test_only_one_process_trains_in_a_run_directory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [*TRAIN, *EPOCH, "--total-steps", "1000", "--out", str(tmp_path / "run")]
    assert run(arguments) == 0
    with RunDirectory.open(tmp_path / "run").locked():
        assert run([*arguments[:-1], str(tmp_path / "run"), "--resume", "--total-steps", "2000"]) == 2
        assert "another process is training here" in capsys.readouterr().err
    assert run(["train", "--resume", "--out", str(tmp_path / "run"), "--total-steps", "2000"]) == 0


@pytest.mark.parametrize("place", ["link", "."])
def test_an_empty_folder_is_trained_in_whatever_it_is(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "disk")
    monkeypatch.chdir(tmp_path / ("disk" if place == "." else "."))
    assert run([*TRAIN, *EPOCH, "--total-steps", "1000", "--out", place]) == 0
    assert (tmp_path / "disk" / "manifest.json").exists()
    assert (tmp_path / "link").is_symlink()
