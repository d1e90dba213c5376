"""`guard suite`: what a grid stands for, and a small one trained, adopted, broken and completed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from guard_api.cli.main import run
from guard_api.errors import SpecError
from guard_api.measure.grid import Grid, parse_options, read_grid

ENV = "Goal_Point_8Hazards"
TINY = ["steps_per_epoch=20", "value_iterations=1", "cg_iterations=2", "threads=1"]
SHORT = """
robot = "point"
episode_length = 20
[task]
type = "Goal"
[[constraints]]
type = "Hazards"
count = 8
"""


@pytest.fixture
def suite(tmp_path: Path) -> list[str]:
    """Arguments for a grid of trainings of 20 steps, which lie in `tmp_path`."""
    (tmp_path / "short.toml").write_text(SHORT)
    size = ["--backends", "ideal", "--total-steps", "20", "--num-worlds", "1"]
    return ["suite", "--envs", str(tmp_path / "short.toml"), *size, "--json", "--out", str(tmp_path)]


def test_a_grid_is_every_combination_and_seeds_come_last(tmp_path: Path) -> None:
    grid = Grid(envs=(ENV,), algos=("trpo", "cpo"), backends=("ideal", "mujoco"), seeds=(0, 3), preset="paper")
    trainings = grid.trainings(tmp_path)
    assert [training.path.name for training in trainings[:4]] == [
        f"{ENV}_trpo_ideal_seed0", f"{ENV}_cpo_ideal_seed0", f"{ENV}_trpo_mujoco_seed0", f"{ENV}_cpo_mujoco_seed0"
    ]  # fmt: skip
    assert {training.seed for training in trainings[4:]} == {3}
    assert {(training.total_steps, training.num_worlds) for training in trainings} == {(6_000_000, 30)}
    assert trainings[1].preset == {"name": "paper", "changed": []}


def test_options_reach_the_algorithms_that_have_them_and_a_table_of_one_wins(tmp_path: Path) -> None:
    file = tmp_path / "grid.toml"
    file.write_text(
        f'envs = ["{ENV}"]\nalgos = ["trpo", "cpo", "pcpo"]\ntotal_steps = 2e6\n'
        "[options]\ncost_limit = 1.0\nhidden = [8]\n[options.cpo]\ncost_limit = 2.0\n"
    )
    grid = read_grid(file, {"seeds": (7,), "options": parse_options(["gamma=0.9", "pcpo.cost_limit=3"])})
    trpo, cpo, pcpo = (training.config for training in grid.trainings(tmp_path))
    assert (cpo.cost_limit, pcpo.cost_limit, hasattr(trpo, "cost_limit")) == (2.0, 3.0, False)
    assert {config.hidden for config in (trpo, cpo, pcpo)} == {(8,)}
    assert {config.gamma for config in (trpo, cpo, pcpo)} == {0.9}
    assert grid.trainings(tmp_path)[0].total_steps == 2_000_000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("envs = [1]\nalgos = ['trpo']", r"envs\[0\]"),
        ("algos = ['trpo']", "envs: is missing"),
        (f"envs = ['{ENV}']\nalgos = ['trpo']\nseed = [1]", "seeds"),
        (f"envs = ['{ENV}']\nalgos = ['tpro']", "trpo"),
        (f"envs = ['{ENV}', '{ENV}']\nalgos = ['trpo']", "each once"),
        (f"envs = ['{ENV}']\nalgos = ['trpo']\noptions.cost_limit = 2.0", "cost_limit"),
        (f"envs = ['{ENV}']\nalgos = ['trpo']\noptions.gamma = 'x'", "options of trpo.gamma"),
        (f"envs = ['{ENV}']\nalgos = ['cpo']\noptions.cpo = 3", "options.cpo is 3: it must be a table"),
        (f"envs = ['{ENV}']\nalgos = ['cpo']\noptions.cost_limits = 'x'", "cost_limits: 'x' is not a table"),
        (f"envs = ['{ENV}']\nalgos = ['cpo']\noptions.cost_limits.hazards = true", "hazards: True is not a number"),
        (f"envs = ['{ENV}']\nalgos = ['trpo']\ntotal_steps = 0", "total_steps"),
        ("envs = [", "cannot be read"),
    ],
)
def test_a_grid_that_means_nothing_is_refused_with_its_key(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "grid.toml"
    file.write_text(text)
    with pytest.raises(SpecError, match=words):
        read_grid(file, {}).trainings(tmp_path)


def test_one_failure_stops_nothing_and_is_named_with_a_non_zero_exit(
    tmp_path: Path, suite: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*suite, "--options", *TINY]
    adopted = ["train", "--env", suite[2], "--backend", "ideal", "--num-worlds", "1", "--total-steps", "20", "--json",
               "--out", str(tmp_path / "short_trpo_ideal_seed0")]  # fmt: skip
    for option in TINY:
        name, value = option.split("=")
        adopted += [f"--{name.replace('_', '-')}", value]
    assert run(adopted) == 0
    log = tmp_path / "short_trpo_ideal_seed0" / "progress.csv"
    before = log.stat().st_mtime_ns
    capsys.readouterr()
    assert run([*arguments, "--algos", "trpo-ipo", "trpo"]) == 1  # a limit of 0 has no inside
    runs = {row["run"]: row for row in json.loads(capsys.readouterr().out)["runs"]}
    states = {name.split("_")[1]: row["state"] for name, row in runs.items()}
    assert states == {"trpo-ipo": "failed", "trpo": "finished"}
    assert "limit above 0" in runs["short_trpo-ipo_ideal_seed0"]["error"]
    assert log.stat().st_mtime_ns == before
    assert run([*arguments, "trpo-ipo.cost_limit=2.0", "--algos", "trpo-ipo", "trpo"]) == 0
    assert "failed" not in capsys.readouterr().out


def test_what_goes_wrong_in_a_run_is_said_with_its_name_when_it_happens_and_in_the_end(
    tmp_path: Path, suite: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Policies that hardly vary their actions from the start, beside one that does."""
    narrow = [*suite, "--algos", "trpo", "cpo", "--options", *TINY, "cpo.initial_log_std=-4"]
    assert run(narrow) == 0
    said = capsys.readouterr()
    runs = {row["run"]: row for row in json.loads(said.out)["runs"]}
    (finding,) = runs["short_cpo_ideal_seed0"]["warnings"]
    assert (finding["epoch"], finding["kind"]) == (1, "entropy-collapse")
    assert runs["short_trpo_ideal_seed0"]["warnings"] == []
    words = "epoch 1: the policy's actions vary by 0.01"
    assert said.err.count(words) == said.err.count(f"short_cpo_ideal_seed0 warning: {words}") == 1
    assert run([item for item in narrow if item != "--json"]) == 0  # nothing is left to train
    assert f"warning: short_cpo_ideal_seed0: {words}" in capsys.readouterr().out
    (tmp_path / "short_cpo_ideal_seed0" / "diagnosis.jsonl").write_text("{}\n")
    assert run(narrow) != 0
    assert "diagnosis.jsonl: holds no findings" in capsys.readouterr().err


@pytest.mark.slow
def test_a_training_that_fails_in_its_process_ends_alone(suite: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [*suite, "--jobs", "2", "--algos", "trpo", "trpo-ipo", "--options", *TINY]
    assert run([*arguments, "--seeds", "0", "1"]) == 1
    states = {row["run"]: row["state"] for row in json.loads(capsys.readouterr().out)["runs"]}
    assert sorted(states.values()) == ["failed", "failed", "finished", "finished"]
