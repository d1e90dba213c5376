"""`guard compare`: what its measures come to as tables, on the page of robots and in its exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from guard_api.cli.main import run
from guard_api.errors import RunError
from guard_api.measure.cells import read_records
from guard_api.measure.robots_page import MEASURES, refresh, tables
from guard_api.measure.targets import measure_targets
from guard_api.runs.atomic import write_json

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_keeps_its_text_and_renews_its_tables(tmp_path: Path):
    assert run(["compare", "endurance", "--robots", "point", "--backends", "ideal", "--num-worlds", "2", "--steps",
                "20", "--out", str(tmp_path), "--json"]) == 0  # fmt: skip
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- begin endurance -->\nold\n<!-- end endurance -->\nafter\n")
    assert run(["compare", "page", "--results", str(tmp_path), "--page", str(page)]) == 0
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    assert "| point | 0 in 20 steps |" in text
    page.write_text("nothing marked")
    with pytest.raises(RunError, match="begin endurance"):
        refresh(page, tmp_path)
    with pytest.raises(RunError, match="no such page"):
        refresh(tmp_path / "other.md", tmp_path)


@pytest.mark.parametrize(("reason", "expected"), [("the physics diverged", 1), ("no free place was left", 0)])
def test_a_lost_world_fails_the_command(tmp_path: Path, monkeypatch, capsys, reason, expected):
    lost = {"steps": 20, "episodes": 1, "failures": {reason: 1}, "fastest": 1.0}
    monkeypatch.setattr("guard_api.cli.compare_command.measure_endurance", lambda *_, **__: lost)
    code = run(["compare", "endurance", "--robots", "point", "--backends", "ideal", "--out", str(tmp_path), "--json"])
    assert code == expected
    assert json.loads(capsys.readouterr().out)[0]["values"]["failures"]


def test_every_measure_has_tables(tmp_path: Path, capsys):
    common = ["--robots", "point", "--backends", "ideal", "--out", str(tmp_path), "--json"]
    sizes = {
        "conformance": [],
        "targets": [],
        "divergence": ["--worlds", "2", "--seconds", "0.1"],
        "locomotion": ["--seeds", "2", "--seconds", "0.1"],
        "bench": ["--num-worlds", "1", "--blocks", "2", "--block-seconds", "0.01"],
        "endurance": ["--num-worlds", "1", "--steps", "2"],
    }
    for measure in MEASURES:
        assert run(["compare", measure, *common, *sizes[measure]]) == 0
        records = json.loads(capsys.readouterr().out)
        made = tables(measure, records)
        assert made, measure
        assert all(len(row) == len(table.columns) for table in made for row in table.rows)
        by_robot = [table for table in made if table.columns[0] == "robot"]
        assert [row[0] for table in by_robot for row in table.rows] == ["point"] * sum(len(t.rows) for t in by_robot)


def test_targets_are_read_from_the_motion_and_starred_when_they_are_not_guards():
    assert measure_targets("point", "ideal") == pytest.approx(
        {"speed ahead": 1.5, "way in 6 s": 8.2, "turning": 3.0, "height": 0.1}, rel=0.02
    )
    arm = measure_targets("arm6", "ideal")
    assert list(arm.values()) == pytest.approx([0.4, 1.5, 1.8], rel=1e-3)
    common = {"backend": "x", "settings": {}, "engines": {}, "manifest": {"git": None}}
    row = tables("targets", [{"robot": "ant", "values": {"height at rest": 0.1105 * 1.021}, **common}])[0].rows[0]
    assert row[:4] == ("ant", "height at rest [m]", "0.1105", "0.113*")
    near = tables("targets", [{"robot": "ant", "values": {"height at rest": 0.1105 * 1.019}, **common}])[0].rows
    assert near[0][3] == "0.113" and near[1][3] == "not yet"


def test_gaps_failures_and_approximations_are_in_the_table_of_conformance():
    found = {"check": "mass_matrix", "what": "m", "value": 2.0, "tolerance": 1.0, "unit": "kg"}
    checks = [found | {"status": "passed", "reason": None}, found | {"status": "failed", "reason": None},
              found | {"status": "gap", "reason": "cannot say"}]  # fmt: skip
    values = {"checks": checks, "approximations": ["wheels are polyhedra"]}
    made = tables("conformance", [{"robot": "car", "backend": "x", "values": values}])
    assert made[0].rows == (("car", "1 hold, 1 gaps, **1 fail**"),)
    assert [row[-1] for row in made[2].rows] == ["m: 2 > 1", "cannot say"]
    assert made[3].rows == (("car", "x", "wheels are polyhedra"),)


def test_the_table_of_tolerances_names_the_robot_that_comes_nearest():
    def record(robot, backend, value):
        check = {"check": "stops_hold", "status": "passed", "reason": None, "value": value, "tolerance": 2.0}
        gap = {"check": "mass_matrix", "status": "gap", "reason": "hidden", "value": 9.0, "tolerance": 1.0}
        return {"robot": robot, "backend": backend, "values": {"checks": [check, gap], "approximations": []}}

    made = tables("conformance", [record("ant", "x", 1.0), record("car", "x", 0.5), record("ant", "y", 1.8)])[1]
    assert made.columns == ("check", "robots", "x", "y")
    assert made.rows == (("stops hold", "2", "0.5, ant", "0.9, ant"),)


def test_a_failed_check_fails_the_command(tmp_path: Path, monkeypatch):
    for status, expected in (("failed", 1), ("gap", 0)):
        check = {"check": "c", "status": status, "reason": "r"}
        made = {"checks": [check], "approximations": []}
        monkeypatch.setattr("guard_api.cli.compare_command.measure_conformance", lambda *_, made=made: made)
        out = ["--robots", "point", "--backends", "ideal", "--out", str(tmp_path), "--again", "--json"]
        assert run(["compare", "conformance", *out]) == expected


def test_refused_robots_are_in_the_tables(tmp_path: Path):
    write_json(tmp_path / "x.json", {"cells": [
        {"robot": "point", "backend": "ideal", "error": "no", "settings": {}, "engines": {}, "manifest": {"git": None}}
    ]})  # fmt: skip
    for measure in ("divergence", "endurance", "bench"):
        assert any(
            "no" in row[-1] for table in tables(measure, read_records(tmp_path / "x.json")) for row in table.rows
        )


def test_the_shipped_page_shows_the_shipped_results():
    page = ROOT / "docs/robots.md"
    assert refresh(page, ROOT / "results/robots") == page.read_text(encoding="utf-8"), "run: guard compare page"
