"""Robots by name: shipped ones, those of plugins, and names that two of them claim."""

from __future__ import annotations

from pathlib import Path

import pytest

from guard_api import plugins
from guard_api.errors import ModelError, PluginError
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
