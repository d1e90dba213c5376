"""`guard robot` and `guard conform --robot` as a user types them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from guard_api import plugins
from guard_api.cli import conform_command, robot_command
from guard_api.cli.main import run
from guard_api.model.library import robot_files
from guard_api.testing.conformance import ConformanceReport, check_robots
from guard_api.viewer import sheet

URDF = next(file for file in robot_files("point") if file.suffix == ".urdf")


def guard(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Run a command in this process; return its exit code, output and error output."""
    capsys.readouterr()
    try:
        code = run(arguments)
    except SystemExit as exit_:
        code = int(exit_.code or 0)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_show_prints_tables_with_units_and_writes_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "140")
    out = tmp_path / "point.png"
    code, table, _ = guard(["robot", "show", "point", "--out", str(out), "--size", "120", "90"], capsys)
    assert code == 0
    for word in ("planar", "mass [kg]", "0.005189", "base_yaw", "velocimeter", "12 numbers", str(out)):
        assert word in table
    with Image.open(out) as image:
        picture = np.asarray(image)
    assert picture.shape == (90, 120, 3)
    assert picture.std() > 10


def test_show_as_json_and_a_picture_named_as_the_robot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = guard(["robot", "show", "point", "--json"], capsys)
    assert code == 0
    assert [file.name for file in tmp_path.iterdir()] == ["point.png"]
    shown = json.loads(out)
    assert shown["name"] == "point"
    assert [row["joint"] for row in shown["joints"]] == ["base_x", "base_y", "base_yaw"]
    sizes = {row["reading"]: row["size"] for row in shown["observation"]}
    assert sizes == dict.fromkeys(("accelerometer", "gyro", "magnetometer", "velocimeter"), 3)
    assert shown["observation"][0]["at home"] == pytest.approx([0.0, 0.0, 9.81])


def test_show_reads_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard(["robot", "show", str(URDF), "--json", "--out", str(tmp_path / "x.png")], capsys)
    assert code == 0
    assert json.loads(out)["robot"]["mass [kg]"] == pytest.approx(0.005188790)


def test_show_all_makes_a_sheet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_command, "robot_names", lambda: ["point", "point", "point"])
    monkeypatch.setattr(sheet, "CELL", (60, 40))
    out = tmp_path / "robots.png"
    code, text, _ = guard(["robot", "show", "all", "--out", str(out), "--json"], capsys)
    assert code == 0
    assert [shown["name"] for shown in json.loads(text)] == ["point"] * 3
    with Image.open(out) as image:
        assert image.size == (3 * 68 + 8, 40 + sheet.CAPTION + 16)


def test_check_compares_the_installed_backends(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard(["robot", "check", "point", "--json"], capsys)
    assert code == 0
    checked = json.loads(out)
    installed = {name for name, reason in plugins.available("guard.backends").items() if reason is None}
    assert {report["backend"] for report in checked["backends"]} == installed
    assert checked["problems"] == []
    for report in checked["backends"]:
        assert len(report["results"]) >= 5
        assert all(":point" in result["name"] for result in report["results"])

    code, table, _ = guard(["robot", "check", str(URDF), "--backends", "ideal"], capsys)
    assert code == 0
    assert "mass matrix" in table
    assert "the same robot in ideal, but for the approximations above in ideal" in table
    assert "ideal: approximation: nothing touches anything" in table


def test_check_is_unreserved_where_nothing_is_approximated(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def exact(*arguments: Any) -> ConformanceReport:
        return replace(check_robots(*arguments), approximations={})

    monkeypatch.setattr(robot_command, "check_robots", exact)
    _, table, _ = guard(["robot", "check", "point", "--backends", "ideal"], capsys)
    assert "the same robot in ideal\n" in table


def test_check_lists_every_problem_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "broken.urdf"
    broken.write_text(
        URDF.read_text()
        .replace('<sphere radius="0.1"/>', '<sphere radius="-1"/>', 1)
        .replace("<mass v", "<mass w")
        .replace("</robot>", "<gazebo/></robot>")
    )
    code, out, err = guard(["robot", "check", str(broken)], capsys)
    assert code == 1
    assert not err
    assert len([line for line in out.splitlines() if line.startswith(f"{broken}:")]) >= 2
    assert "cannot be used" in out
    assert any(line.startswith("note: ") and "gazebo" in line for line in out.splitlines())
    code, out, _ = guard(["robot", "check", str(broken), "--json"], capsys)
    assert code == 1
    assert len(json.loads(out)["problems"]) >= 2
    assert any("gazebo" in note for note in json.loads(out)["notes"])


def test_check_fails_when_a_backend_builds_another_robot(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    backend = plugins.load("guard.backends", "ideal")
    monkeypatch.setattr(robot_command.plugins, "load", lambda group, name: _Heavier(backend))
    code, out, _ = guard(["robot", "check", "point", "--backends", "heavier"], capsys)
    assert code == 1
    assert "not the same robot in heavier" in out
    assert "failed" in out


def test_check_names_the_gaps_of_the_robot_that_it_looks_at(capsys: pytest.CaptureFixture[str]) -> None:
    """A gap that the simulator declares excuses nobody silently: the last line says which it made use of."""
    pytest.importorskip("guard_sapien")
    code, out, _ = guard(["robot", "check", "car", "--backends", "sapien"], capsys)
    assert code == 0
    last = " ".join(out.splitlines()[-1].split())
    assert last == "the same robot in sapien, but for the gaps above in sapien and the approximations above in sapien"


class _Heavier:
    """The ideal backend with every link twice as heavy."""

    name, api_version = "heavier", 1

    def __init__(self, backend) -> None:
        self._backend, self.capabilities, self.versions = backend, backend.capabilities, backend.versions

    def build(self, scene, num_worlds, threads=1):
        links = tuple(replace(link, mass=2 * link.mass) for link in scene.robot.links)
        return self._backend.build(replace(scene, robot=replace(scene.robot, links=links)), num_worlds, threads)


def test_conform_one_robot_on_one_backend(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = guard(["conform", "--backend", "ideal", "--robot", "point"], capsys)
    assert code == 0
    assert "C4" in out
    assert "0 failed" in out


def test_conform_all_robots_on_all_backends(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conform_command, "robot_names", lambda: ["point"])
    code, out, _ = guard(["conform", "--backend", "all", "--robot", "all", "--clause", "C3"], capsys)
    assert code == 0
    assert "1 passed" in out
    installed = [name for name, reason in plugins.available("guard.backends").items() if reason is None]
    assert all(name in out for name in installed)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["robot", "show", "pont"], ["pont", "point"]),
        (["robot", "check", "pont"], ["pont", "point"]),
        (["robot", "show", "nowhere/x.urdf"], ["nowhere/x.urdf"]),
        (["robot", "show", "point", "--out", "x.png", "--size", "0", "90"], ["size is 0"]),
        (["robot"], ["show", "check"]),
        (["conform", "--backend", "ideal", "--robot", "pont"], ["pont", "point"]),
        (["conform", "--backend", "ideal", "--robot", "point", "--clause", "C7"], ["C7", "C12"]),
    ],
    ids=lambda value: "_".join(value[:3]) if isinstance(value, list) else "",
)
def test_wrong_requests(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = guard(arguments, capsys)
    assert code == 2
    assert all(word in err for word in words), err
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir()), "a refused command must leave nothing behind"
