"""`guard robot`: show a robot as tables and a picture; check a robot's files and what the simulators make of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import tyro

from guard_api import plugins
from guard_api.cli.conform_command import ALL, installed_backends
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.cli.robot_tables import robot_tables
from guard_api.errors import ModelError
from guard_api.model.library import load_robot, robot_names
from guard_api.model.robot import RobotModel
from guard_api.testing.conformance import ConformanceReport, check_robots
from guard_api.viewer import SIZE, contact_sheet, robot_picture, write_png

WHICH = "Name of a robot (`guard list robots`), or its URDF or MJCF file, beside which a robot.toml is used"


@dataclass(frozen=True, slots=True, kw_only=True)
class Show:
    """Print a robot as tables and write a picture of it."""

    robot: Annotated[str, tyro.conf.Positional, tyro.conf.arg(help=f"{WHICH}; `all` for every robot at once.")]
    out: Path | None = None
    """Picture to write (PNG); NAME.png, or robots.png, in this folder when left out."""
    size: tuple[int, int] = SIZE
    """Width and height of the picture [pixel]; the sheet of all robots has its own."""
    json: bool = False
    """Print JSON instead of tables."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """Print what is wrong with a robot's files, or how exactly every installed simulator builds the robot."""

    robot: Annotated[str, tyro.conf.Positional, tyro.conf.arg(help=f"{WHICH}.")]
    backends: tuple[str, ...] = ()
    """Simulators to compare; all that are installed when left out."""
    json: bool = False
    """Print JSON, with every measurement, instead of tables."""


Options = Annotated[Show, tyro.conf.subcommand("show")] | Annotated[Check, tyro.conf.subcommand("check")]


def main(argv: Sequence[str]) -> int:
    """Run the command; exit code 1 when the checked robot has a problem."""
    options = parse(cast("type[Show | Check]", Options), "robot", argv, "Show a robot, or check its files.")
    return _show(options) if isinstance(options, Show) else _check(options)


def _show(options: Show) -> int:
    robots = [load_robot(name) for name in robot_names()] if options.robot == ALL else [load_robot(options.robot)]
    sheet = options.robot == ALL
    out = options.out or Path("robots.png" if sheet else f"{robots[0].name}.png")
    write_png(out, contact_sheet(robots) if sheet else robot_picture(robots[0], size=options.size))
    tables = [{"name": robot.name, **robot_tables(robot)} for robot in robots]
    if options.json:
        print_json(tables if sheet else tables[0])
        return 0
    for robot, described in zip(robots, tables, strict=True):
        _print_robot(robot, described)
    print(f"picture: {out}")
    return 0


def _print_robot(robot: RobotModel, described: dict[str, Any]) -> None:
    print_table(robot.name, ("property", "value"), ((key, _text(value)) for key, value in described["robot"].items()))
    for title in ("links", "joints", "actuators", "sensors", "observation"):
        rows = described[title]
        shown = [name for name in (rows[0] if rows else ()) if any(_text(row[name]) for row in rows)]
        if rows:
            print_table(title, shown, ([_text(row[name]) for name in shown] for row in rows))
    print(f"{sum(row['size'] for row in described['observation'])} numbers in the observation are the robot's own")
    for note in described["notes"]:
        print(f"note: {note}")


def _text(value: Any) -> str:
    """Return `value` as a table shows it; nothing for what is unlimited, absent or zero."""
    match value:
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.4g}" if value and abs(value) < float("inf") else ""
        case list():
            return " ".join(item if isinstance(item, str) else f"{item:.4g}" for item in value)
        case dict():
            return ", ".join(f"{name} {number:g}" for name, number in value.items())
        case _:
            return "" if value is None else str(value)


def _check(options: Check) -> int:
    try:
        robot = load_robot(options.robot)
    except ModelError as error:
        problems = str(error).splitlines()
        if options.json:
            print_json({"robot": options.robot, "problems": problems, "notes": list(error.notes)})
        else:
            notes = [f"note: {note}" for note in error.notes]
            print(*problems, *notes, f"{len(problems)} problems: {options.robot} cannot be used", sep="\n")
        return 1
    names = options.backends or installed_backends()
    reports = [check_robots(plugins.load("guard.backends", name), [robot]) for name in names]
    if options.json:
        backends = [report.to_dict() for report in reports]
        print_json({"robot": robot.name, "problems": [], "notes": robot.notes, "backends": backends})
    else:
        _print_check(robot, reports)
    return 0 if all(report.passed for report in reports) else 1


def _print_check(robot: RobotModel, reports: Sequence[ConformanceReport]) -> None:
    """Print the notes of `robot`, a table of findings by backends, what they approximate, and why a check failed."""
    for note in robot.notes:
        print(f"note: {note}")
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for report in reports:
        for result in report.results:
            for finding in result.findings:
                mark = "" if finding.holds else f" > {finding.tolerance:.0e}: {result.status}"
                row = cells.setdefault((finding.what, finding.unit), {})
                row[report.backend] = f"{finding.value:.1e}{mark}"
    names = [report.backend for report in reports]
    rows = [(what, unit, *(row.get(name, "") for name in names)) for (what, unit), row in cells.items()]
    print_table(f"{robot.name}: largest difference from the model", ("quantity", "unit", *names), rows)
    for report in reports:
        for sentence in report.approximations.get(robot.name, ()):
            print(f"{report.backend}: approximation: {sentence}")
        for result in report.results:
            if result.reason:
                print(f"{report.backend}: {result.title} {result.status}: {result.reason}")
    failed = [report.backend for report in reports if not report.passed]
    if failed:
        print(f"not the same robot in {', '.join(failed)}")
        return
    excepted = {
        "gaps": [report.backend for report in reports if any(r.status.startswith("gap") for r in report.results)],
        "approximations": [report.backend for report in reports if report.approximations.get(robot.name)],
    }
    but = " and ".join(f"the {what} above in {', '.join(where)}" for what, where in excepted.items() if where)
    print(f"the same robot in {', '.join(names)}{f', but for {but}' if but else ''}")
