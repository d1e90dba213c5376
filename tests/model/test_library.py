"""Robots by name: shipped ones, those of plugins, and names that two of them claim."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from guard_api import plugins, suite
from guard_api.cli import doctor_command, list_command
from guard_api.env import make_environment
from guard_api.errors import ModelError, PluginError, SpecError
from guard_api.model import library
from tests.model.files import link, robot


@pytest.fixture
def plugin_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty root that a plugin brings."""
    monkeypatch.setattr(plugins, "names", lambda group: {"guard.robots": ["extra", "shipped"]}[group])
    roots = {"extra": lambda: tmp_path, "shipped": library.shipped_root}
    monkeypatch.setattr(plugins, "load", lambda group, name: roots[name])
    return tmp_path


def add(root: Path, name: str, toml: str | None = "licence = 'CC0-1.0'") -> None:
    folder = root / "urdf" / name
    folder.mkdir(parents=True)
    (folder / f"{name}.urdf").write_text(robot(link("body")))
    if toml is not None:
        (folder / "robot.toml").write_text(toml)


def test_a_plugin_brings_robots(plugin_root: Path) -> None:
    add(plugin_root, "lander")
    (plugin_root / "urdf" / "notes").mkdir()  # not a robot
    assert "lander" in library.robot_names()
    assert "point" in library.robot_names()
    assert "notes" not in library.robot_names()
    model = library.load_robot.__wrapped__("lander")
    assert (model.name, model.licence) == ("lander", "CC0-1.0")


def test_two_robots_of_one_name_are_refused(plugin_root: Path) -> None:
    add(plugin_root, "point")
    with pytest.raises(PluginError, match="two robots are called 'point'"):
        library.robot_names()


def test_a_robot_in_the_library_needs_its_side_file(plugin_root: Path) -> None:
    add(plugin_root, "bare", toml=None)
    with pytest.raises(ModelError, match=r"robot\.toml: cannot be read"):
        library.load_robot.__wrapped__("bare")


def test_a_robot_in_a_folder_of_another_name_is_refused(plugin_root: Path) -> None:
    add(plugin_root, "duo")
    (plugin_root / "urdf" / "duo").rename(plugin_root / "urdf" / "typo")
    with pytest.raises(
        PluginError,
        match=r"no typo\.urdf in .*/urdf/typo, but duo\.urdf, robot\.toml: a robot's file is",
    ):
        library.robot_names()


@pytest.mark.parametrize("file", ["duo/duo.urdf", "duo.xml"])
def test_a_path_where_no_file_is(file: str) -> None:
    with pytest.raises(SpecError, match=rf"robot '{file}': there is no such file"):
        library.load_robot(file)


def test_an_environment_needs_a_robot_that_can_act(plugin_root: Path) -> None:
    add(plugin_root, "lump")
    with pytest.raises(SpecError, match=r"robot 'lump' has no actuators.*\[\[actuators\]\] to .*/lump/robot\.toml"):
        make_environment("Goal_Lump_8Hazards", backend="ideal")


def test_a_broken_robot_is_a_row_among_the_others(
    plugin_root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    add(plugin_root, "heavy")
    file = plugin_root / "urdf" / "heavy" / "heavy.urdf"
    file.write_text(robot(link("body", mass=-0.2)))
    problem = f"{file}:2: link 'body': mass -0.2 kg must be positive"
    assert list_command.main(["robots", "--json"]) == 0
    listed = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert listed["heavy"]["note"].startswith(problem)
    assert (listed["point"]["actions"], listed["point"]["note"]) == (2, "")

    monkeypatch.setattr(suite, "term_names", lambda kind: {"task": ["Goal"], "constraint": ["Hazards"]}[kind])
    assert list_command.main(["envs", "--json"]) == 0
    robots = {row["robot"] for row in json.loads(capsys.readouterr().out)}
    assert "point" in robots
    assert "heavy" not in robots

    for other in ("_backends", "_algorithms"):
        monkeypatch.setattr(doctor_command, other, list)
    assert doctor_command.main(["--json"]) == 1
    states = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert states["robot heavy"]["state"] == "broken"
    assert states["robot heavy"]["note"].startswith(problem)
    assert states["robots"]["note"] == f"{len(listed) - 1} can be read"
