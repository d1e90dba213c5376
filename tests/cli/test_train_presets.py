"""`guard train --preset`: what a preset decides, what wins over it, and what the run directory says of it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from guard_algos.config import PAPER
from guard_api import plugins
from guard_api.algorithm import deciding_options, find_preset
from guard_api.cli.main import run

TINY = ["--env", "Goal_Point_8Hazards", "--backend", "mujoco", "--num-worlds", "1", "--total-steps", "1000"]
TINY += ["--steps-per-epoch", "1000", "--value-iterations", "1", "--json"]
NO_VALUE_IN_THE_PAPER = {"barrier_t", "multiplier_max", "cost_limits", "thresholds"}


def read(file: Path) -> dict:
    return json.loads(file.read_text())


def test_explicit_flags_win_over_the_preset_and_the_manifest_says_which(tmp_path: Path) -> None:
    assert run(["train", *TINY, "--algo", "cpo", "--preset", "paper", "--cost-limit", "2", "--out", str(tmp_path)]) == 0
    config, manifest = read(tmp_path / "config.json"), read(tmp_path / "manifest.json")
    assert (config["cg_damping"], config["cg_iterations"]) == (0.0, 100)
    assert (config["cost_limit"], config["steps_per_epoch"]) == (2.0, 1000)
    changed = {"steps_per_epoch", "value_iterations", "cost_limit", "num_worlds", "total_steps"}
    assert manifest["preset"].keys() == {"name", "changed"}
    assert (manifest["preset"]["name"], set(manifest["preset"]["changed"])) == ("paper", changed)


def test_a_run_without_a_preset_says_so_and_has_the_defaults(tmp_path: Path) -> None:
    assert run(["train", *TINY, "--out", str(tmp_path)]) == 0
    assert read(tmp_path / "manifest.json")["preset"] is None
    assert read(tmp_path / "config.json")["cg_damping"] == 0.1


def test_help_shows_the_preset_s_values(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run(["train", "--preset", "paper", "--help"])
    assert "6000000" in capsys.readouterr().out


def test_an_unknown_preset_is_named_with_those_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["train", *TINY, "--preset", "papre", "--out", "x"]) == 2
    assert "paper" in capsys.readouterr().err


@pytest.mark.parametrize("name", plugins.names("guard.algorithms"))
def test_the_paper_decides_every_option_that_it_or_its_code_names(name: str) -> None:
    algorithm = plugins.load("guard.algorithms", name)
    preset = find_preset(algorithm, "paper")
    config = algorithm.config_type(**preset.options)
    assert deciding_options(config).keys() - preset.options.keys() <= NO_VALUE_IN_THE_PAPER
    assert preset.changed(total_steps=6_000_000, num_worlds=30, config=config) == []
    other = dataclasses.replace(config, gamma=0.5, threads=7)
    assert preset.changed(total_steps=6_000_000, num_worlds=31, config=other) == ["gamma", "num_worlds"]


def test_no_value_of_the_paper_is_left_without_an_option() -> None:
    configs = [plugins.load("guard.algorithms", name).config_type for name in plugins.names("guard.algorithms")]
    assert PAPER.keys() <= {field.name for config in configs for field in dataclasses.fields(config)}
