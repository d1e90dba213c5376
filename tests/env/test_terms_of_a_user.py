"""A task and a constraint from outside GUARD: in Python, by name through entry points, and as JSON."""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from guard_api.cli.main import run
from guard_api.env import make_environment
from guard_api.errors import PluginError, SpecError
from guard_api.model.library import robot_names
from guard_api.spec import EnvSpec
from guard_api.suite import make_spec
from tests.env.staging import drive, put

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_task.py"


@pytest.fixture
def own_task(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The example as an importable module."""
    spec = importlib.util.spec_from_file_location("own_task", EXAMPLE)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "own_task", module)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def offer(own_task: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Install a package that offers what its entry points say."""

    def install(entry_points: str) -> None:
        info = tmp_path / "own_task-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-task\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(entry_points)
        monkeypatch.syspath_prepend(str(tmp_path))

    return install


@pytest.fixture
def installed(own_task: ModuleType, offer: Callable[[str], None]) -> ModuleType:
    """The example as what an installed package offers."""
    offer("[guard.tasks]\nVisit = own_task:Visit\n\n[guard.constraints]\nPuddles = own_task:Puddles\n")
    return own_task


def test_the_example_runs(own_task: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    own_task.main("mujoco" if importlib.util.find_spec("mujoco") else "ideal")
    printed = capsys.readouterr().out
    assert "puddles_lidar" in printed
    assert "return:" in printed


def test_own_terms_pay_and_cost(own_task: ModuleType) -> None:
    terms = {"task": own_task.Visit(), "constraints": (own_task.Puddles(count=1),)}
    env = make_environment(EnvSpec(name="own", robot="point", **terms), backend="ideal", num_worlds=2)
    put(
        env,
        np.zeros((1, 2)),
        flag=np.array([[[0.2, 0.0]], [[0.4, 0.0]]]),
        puddles=np.array([[[0.0, 0.0]], [[9.0, 0.0]]]),
    )
    rewards, costs = drive(env, (1.0, 0.0), 1)
    assert rewards[0] == pytest.approx([env.duration + 1.0, 0.0])
    assert costs[0, 0, 0] == pytest.approx(env.snapshot.linear_velocity[0, 0])
    assert costs[0, 0, 0] > 0.0
    assert costs[0, 1, 0] == 0.0


def test_installed_terms_have_names_and_survive_json(installed: ModuleType) -> None:
    spec = make_spec("Visit_Point_3Puddles")
    assert spec.task == installed.Visit()
    assert spec.constraints == (installed.Puddles(count=3),)
    again = EnvSpec.from_json(json.loads(json.dumps(spec.to_json())))
    assert again == spec
    with pytest.raises(SpecError, match="did you mean Visit"):
        make_spec("Visi_Point_3Puddles")


def test_installed_terms_are_listed_and_choose_among_environments(
    installed: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    def listed(*arguments: str) -> dict[str, dict[str, str]]:
        assert run(["list", *arguments, "--json"]) == 0
        return {row["name"]: row for row in json.loads(capsys.readouterr().out)}

    assert listed("tasks")["Visit"]["what"].startswith("Be at a flag")
    assert listed("constraints")["Puddles"]["what"] == installed.Puddles.__doc__
    both = listed("envs", "--task", "Visit", "--constraint", "Puddles")
    assert set(both) == {f"Visit_{robot.capitalize()}_8Puddles" for robot in robot_names()}
    assert listed("envs", "--constraint", "Puddles", "--robot", "point").keys() > {"Goal_Point_8Puddles"}
    assert "Visit_Ant_8Ghosts" in listed("envs", "--task", "Visit")
    assert "Visit_Ant_8Ghosts" not in listed("envs", "--task", "Goal")


@pytest.mark.parametrize(
    ("offered", "message"),
    [
        ("nowhere:Visit", "cannot be imported"),
        ("own_task:Absent", "does not exist"),
        ("own_task:Puddles", "must name a dataclass called Visit"),
        ("own_task:main", "must name a dataclass called Visit"),
    ],
)
def test_a_broken_package_is_named_where_it_is_asked_for_and_hides_nothing_else(
    offer: Callable[[str], None], offered: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    offer(f"[guard.tasks]\nVisit = {offered}\n")
    with pytest.raises(PluginError, match=message):
        make_spec("Visit_Point_3Hazards")
    assert run(["list", "envs", "--task", "Visit"]) == 2
    assert message in capsys.readouterr().err
    assert run(["list", "tasks", "--json"]) == 0
    assert any(message in row["what"] for row in json.loads(capsys.readouterr().out))
    assert run(["list", "envs", "--robot", "point", "--json"]) == 0
    names = [row["name"] for row in json.loads(capsys.readouterr().out)]
    assert "Goal_Point_8Hazards" in names
    assert not any(name.startswith("Visit") for name in names)


def test_a_constraint_that_is_not_made_of_a_count_has_no_name(
    offer: Callable[[str], None], own_task: ModuleType
) -> None:
    offer("[guard.constraints]\nVisit = own_task:Visit\n")
    with pytest.raises(PluginError, match=r"constraint 'Visit' cannot be made of a count.*'count'"):
        make_spec("Goal_Point_3Visit")


def test_terms_that_are_not_installed_are_unknown() -> None:
    with pytest.raises(SpecError, match="unknown task 'Visit'"):
        make_spec("Visit_Point_3Hazards")
