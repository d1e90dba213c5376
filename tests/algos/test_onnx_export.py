"""Exported policies act as the policies that were trained, corrections included, in another runtime."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from guard_algos import onnx_export, trpo, trpo_sl, trpo_usl
from guard_api.errors import RunError
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import final_policy, train
from tests.algos.corridor import Corridor

onnxruntime = pytest.importorskip("onnxruntime", reason="extra `export` is not installed")
pytest.importorskip("onnxscript", reason="extra `export` is not installed")

OPTIONS: dict[str, Any] = {"steps_per_epoch": 1000, "hidden": (8,), "value_iterations": 20, "threads": 1}
CONTRACT = {"observation_size": 2, "action_size": 2}


def exported(algorithm: Any, folder: Path, **options: Any) -> tuple[Any, dict[str, Any], Any]:
    """Return the runtime's session of an exported policy, the contract in the file and the policy itself."""
    train(algorithm, Corridor(line=0.0), folder / "run", algorithm.config_type(**OPTIONS, **options), 3000)
    checkpoint = RunDirectory.open(folder / "run").last_checkpoint()
    returned = algorithm.export_policy(checkpoint, folder / "policy.onnx", CONTRACT)
    session = onnxruntime.InferenceSession(str(folder / "policy.onnx"), providers=["CPUExecutionProvider"])
    stored = json.loads(session.get_modelmeta().custom_metadata_map[onnx_export.CONTRACT])
    assert stored == returned
    assert [value.name for value in session.get_inputs()] == stored["inputs"]
    return session, stored, final_policy(algorithm, folder / "run")


def compare(session: Any, policy: Any, inputs: list[str]) -> np.ndarray:
    """Assert that both act alike for 1 and 50 worlds; return the actions."""
    rng = np.random.default_rng(5)
    action = np.empty(0)
    for worlds in (1, 50):
        feed = {"observation": rng.uniform(-1, 2, (worlds, 2)), "costs": np.maximum(rng.uniform(-1, 1, (worlds, 2)), 0)}
        feed = {name: x.astype(np.float32) for name, x in feed.items()}
        (action,) = session.run(None, {name: feed[name] for name in inputs})
        np.testing.assert_allclose(action, policy.act(feed["observation"], True, feed["costs"]), atol=1e-5)
    return action


def test_a_policy_without_a_layer_needs_observations_only(tmp_path: Path) -> None:
    session, contract, policy = exported(trpo.algorithm, tmp_path)
    assert contract["inputs"] == ["observation"]
    assert not contract["corrected"]
    assert contract["self_test"]["largest_difference"] < 1e-5
    compare(session, policy, contract["inputs"])


def test_an_environment_of_another_size_is_refused(tmp_path: Path) -> None:
    train(trpo.algorithm, Corridor(), tmp_path / "run", trpo.algorithm.config_type(**OPTIONS), 1000)
    checkpoint = RunDirectory.open(tmp_path / "run").last_checkpoint()
    assert checkpoint is not None
    with pytest.raises(RunError, match=r"has \(3, 2\) observations and actions"):
        trpo.algorithm.export_policy(checkpoint, tmp_path / "a.onnx", {"observation_size": 3, "action_size": 2})
    assert not (tmp_path / "a.onnx").exists()


@pytest.mark.slow
def test_a_file_that_does_not_act_alike_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnx_export, "TOLERANCE", -1.0)
    with pytest.raises(RunError, match="not written: its actions differ"):
        exported(trpo.algorithm, tmp_path)
    assert not (tmp_path / "policy.onnx").exists()


@pytest.mark.slow
def test_a_safety_layer_is_part_of_the_file_and_needs_the_costs(tmp_path: Path) -> None:
    thresholds = {"line": 0.05, "spare": 0.1}
    session, contract, policy = exported(trpo_sl.algorithm, tmp_path, thresholds=thresholds)
    assert contract["inputs"] == ["observation", "costs"]
    assert contract["corrected"]
    action = compare(session, policy, contract["inputs"])
    assert (np.abs(action) == 1).any()  # corrections that end at a bound are among them


@pytest.mark.slow
def test_an_unrolled_layer_is_part_of_the_file(tmp_path: Path) -> None:
    options = {"threshold": 0.05, "correction_iterations": 3, "correction_rate": 0.2}
    session, contract, policy = exported(trpo_usl.algorithm, tmp_path, **options)
    assert contract["inputs"] == ["observation"]
    assert contract["corrected"]
    compare(session, policy, contract["inputs"])
