"""`guard list envs`: its filters, and specification files wherever a name is accepted."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import pytest

from guard_api.cli.main import run

EXAMPLE = str(Path(__file__).parents[2] / "examples" / "environment.toml")


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, str]]:
    assert run(["list", "envs", "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_suite_has_72_environments(capsys: pytest.CaptureFixture[str]) -> None:
    names = [row["name"] for row in listed(capsys, "--suite")]
    assert len(set(names)) == len(names) == 72
    assert {"Goal_Point_8Hazards", "Defense_Drone_8Ghosts"} <= set(names)
    assert "Goal_Car_8Hazards" not in names


def test_filters_hold_together(capsys: pytest.CaptureFixture[str]) -> None:
    rows = listed(capsys, "--task", "Push", "--robot", "Ant")
    assert {(row["task"], row["robot"]) for row in rows} == {("Push", "ant")}
    assert len(rows) > 5
    (row,) = listed(capsys, "--suite", "--task", "Chase", "--robot", "arm6", "--constraint", "Ghosts")
    assert row == {"name": "Chase_Arm6_8Ghosts", "robot": "arm6", "task": "Chase", "constraints": "ghosts"}
    several = listed(capsys, "--constraint", "Gremlins")
    assert "PointButton1" in [row["name"] for row in several]
    assert all("gremlins" in row["constraints"] for row in several)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["envs", "--task", "Gaol"], "unknown task 'Gaol': did you mean Goal"),
        (["envs", "--robot", "pont"], "unknown robot 'pont': did you mean point"),
        (["envs", "--constraint", "Hazard"], "did you mean Hazards"),
        (["envs", "--suite", "--robot", "car"], "no listed environment fits"),
        (["robots", "--task", "Goal"], "choose among environments"),
    ],
)
def test_what_cannot_be_listed_is_one_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["list", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1


def test_a_specification_file_is_shown_trained_in_and_evaluated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["env", EXAMPLE, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["robot"] == "car"
    out = tmp_path / "run"
    train = ["--algo", "trpo", "--backend", "mujoco", "--num-worlds", "2", "--steps-per-epoch", "1000"]
    tiny = ["--total-steps", "1000", "--value-iterations", "1", "--out", str(out)]
    assert run(["train", "--env", EXAMPLE, *train, *tiny, "--json"]) == 0
    capsys.readouterr()
    assert run(["eval", str(out), "--episodes", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["length"] == [500]


def test_gymnasium_makes_a_specification_file() -> None:
    env = gymnasium.make("guard_api.gym:guard/Goal_Point_8Hazards-v0", env=EXAMPLE, backend="ideal")
    assert env.unwrapped.environment.spec.robot == "car"
    env.close()
