"""Every engine takes robots where it took them when its recording was made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from guard_api import plugins
from guard_api.errors import RunError
from guard_api.runs.atomic import read_json
from guard_api.testing import golden

FOLDER = Path(__file__).parent / "golden"
POINT = golden.TAPES[0]


@pytest.mark.parametrize("tape", golden.TAPES, ids=lambda tape: tape.robot)
def test_trajectory_is_the_recorded_one(backend_name, tape):
    backend = plugins.load("guard.backends", backend_name)
    comparison = golden.compare(backend, read_json(FOLDER / f"{backend_name}.json", golden.REMEDY), tape)
    assert comparison.holds, str(comparison)
    if comparison.moved:
        pytest.skip(f"holds, but is out of date: {comparison}")


@pytest.fixture
def ideal():
    return plugins.load("guard.backends", "ideal")


def test_a_run_repeats_its_own_recording_bit_for_bit(ideal):
    comparison = golden.compare(ideal, golden.record(ideal, [POINT]), POINT)
    assert comparison.exact and comparison.deviation == 0.0 and not comparison.moved


def test_a_small_move_fails_on_the_same_version_and_says_so_on_another(ideal):
    recording = golden.record(ideal, [POINT])
    values = recording["tapes"]["point"]["arrays"]["joint_position"]["values"]
    values[0] = (float.fromhex(values[0]) + 1e-9).hex()
    assert not golden.compare(ideal, recording, POINT).holds

    recording["versions"] = {name: "0.0.1" for name in recording["versions"]}
    comparison = golden.compare(ideal, recording, POINT)
    assert comparison.holds
    assert "point is 1.0e-09 from" in str(comparison)
    assert "0.0.1 ->" in str(comparison) and "--record" in str(comparison)


def test_a_recording_of_another_tape_is_refused(ideal):
    recording = golden.record(ideal, [POINT])
    for tape in (replace(POINT, steps=51), replace(POINT, robot="drone")):
        with pytest.raises(RunError, match="another tape"):
            golden.compare(ideal, recording, tape)


def test_recording_and_comparing_from_the_command_line(tmp_path, capsys):
    chosen = ["--backend", "ideal", "--folder", str(tmp_path)]
    assert golden.main(chosen) == 2
    assert "--record" in capsys.readouterr().err
    assert golden.main([*chosen, "--record"]) == 0
    assert golden.main(chosen) == 0
