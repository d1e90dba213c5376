"""`guard env`: what is shown of environments."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from guard_api.cli.main import run


def test_what_an_environment_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["env", "Goal_Point_2Hazards_1Vases", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["costs"] == ["hazards", "vases"]
    assert row["layout"]["goal_compass"] == [3, 5]
    assert row["observation"] == 46
    assert "1 vases (dynamic)" in row["objects"]


def test_a_sheet_of_several(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("guard_api.cli.env_command.CELL", (48, 38))
    monkeypatch.setattr("guard_api.viewer.sheet.CELL", (48, 38))
    assert run(["env", "Goal_Point_1Hazards", "Circle_Point_1Walls", "--out", str(tmp_path / "page.png")]) == 0
    with Image.open(tmp_path / "page.png") as page:
        assert page.width > 2 * 48


def test_an_unknown_environment_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["env", "Gaol_Point_8Hazards"]) == 2
    assert "did you mean Goal" in capsys.readouterr().err


def test_without_an_environment_it_says_what_to_give(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["env"]) == 2
    output = capsys.readouterr()
    assert output.err.startswith("guard env: name an environment, such as Goal_Point_8Hazards")
    assert output.err.count("\n") == 1
    assert not output.out


def test_too_many_objects_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["env", "Goal_Point_1000000Hazards"]) == 2
    error = capsys.readouterr().err
    assert "a scene may hold 1000 things in all" in error
    assert error.count("\n") == 1
