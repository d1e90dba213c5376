"""`guard export`: one file whose metadata says what goes in and what comes out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from guard_api.cli.main import run

onnxruntime = pytest.importorskip("onnxruntime", reason="extra `export` is not installed")
pytest.importorskip("onnxscript", reason="extra `export` is not installed")

TRAIN = ["train", "--env", "Goal_Point_8Hazards", "--algo", "trpo", "--backend", "ideal", "--total-steps", "1000",
         "--num-worlds", "1", "--steps-per-epoch", "1000", "--value-iterations", "1", "--json"]  # fmt: skip


@pytest.mark.slow
def test_the_file_says_what_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*TRAIN, "--out", str(tmp_path / "run")]) == 0
    capsys.readouterr()
    assert run(["export", str(tmp_path / "run"), "--out", str(tmp_path / "policy.onnx"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    session = onnxruntime.InferenceSession(str(tmp_path / "policy.onnx"), providers=["CPUExecutionProvider"])
    stored = json.loads(session.get_modelmeta().custom_metadata_map["guard.contract"])
    assert printed == {"out": str(tmp_path / "policy.onnx"), **stored}
    assert stored["env"] == "Goal_Point_8Hazards"
    assert stored["costs"] == ["hazards"]
    ends = [part for part in stored["observation"].values()]
    assert ends[0][0] == 0 and ends[-1][1] == stored["observation_size"]
    assert len(stored["action"]) == stored["action_size"] == 2
    (action,) = session.run(None, {"observation": np.zeros((7, stored["observation_size"]), np.float32)})
    assert np.asarray(action).shape == (7, 2)


def test_a_run_without_a_checkpoint_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from guard_api.runs.directory import RunDirectory

    RunDirectory.create(tmp_path / "run", manifest={"algorithm": "trpo"}, config={}).close()
    assert run(["export", str(tmp_path / "run"), "--out", str(tmp_path / "policy.onnx")]) == 2
    assert "has no checkpoint yet" in capsys.readouterr().err
