"""`guard list`: what there is."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import tyro

from guard_api import plugins
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.errors import ModelError, PluginError, SpecError, unknown_name
from guard_api.model.library import load_robot, robot_names
from guard_api.spec import EnvSpec, Kind, term_names, term_type
from guard_api.suite import known_names, make_spec, suite_names

Listing = Literal["envs", "robots", "tasks", "constraints", "algos", "backends"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What to list, and how. The last four choose among environments."""

    kind: Annotated[Listing, tyro.conf.Positional] = "envs"
    """What to list."""
    json: bool = False
    """Print JSON instead of a table."""
    suite: bool = False
    """Only GUARD's suite: four tasks, nine robots, eight hazards or ghosts."""
    task: str | None = None
    """Only environments of this task, such as Goal."""
    robot: str | None = None
    """Only environments of this robot, such as ant."""
    constraint: str | None = None
    """Only environments with this constraint, such as Ghosts."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "list", argv, "Show what there is to use.")
    if options.kind == "envs":
        rows = _environments(options)
    elif options.suite or options.task or options.robot or options.constraint:
        raise SpecError("--suite, --task, --robot and --constraint choose among environments: use them with 'envs'")
    else:
        rows = _LISTINGS[options.kind]()
    if options.json:
        print_json(rows)
    else:
        columns = list(rows[0]) if rows else ["name"]
        print_table(options.kind, columns, ([row[column] for column in columns] for row in rows))
    return 0


def _environments(options: Options) -> list[dict[str, Any]]:
    """Return the environments asked for. Raises SpecError for an unknown name, or when there is none of that kind."""
    robot = None if options.robot is None else options.robot.lower()
    if options.task is not None:
        term_type("task", options.task)
    if options.constraint is not None:
        term_type("constraint", options.constraint)
    if robot is not None and robot not in robot_names():
        raise unknown_name("robot", robot, robot_names())
    specs = _specs(suite_names() if options.suite else known_names())
    chosen = [spec for spec in specs if _fits(spec, options.task, robot, options.constraint)]
    if not chosen:
        raise SpecError("no listed environment fits: leave one of --suite, --task, --robot and --constraint out")
    return [
        {
            "name": spec.name,
            "robot": spec.robot,
            "task": type(spec.task).__name__,
            "constraints": " ".join(constraint.name for constraint in spec.constraints),
        }
        for spec in chosen
    ]


def _specs(names: list[str]) -> Iterator[EnvSpec]:
    """Yield what `names` stand for, without those of a broken package: the lists of robots and terms say why."""
    for name in names:
        with contextlib.suppress(PluginError, ModelError):
            yield make_spec(name)


def _fits(spec: EnvSpec, task: str | None, robot: str | None, constraint: str | None) -> bool:
    constraints = [type(term).__name__ for term in spec.constraints]
    return (
        task in (None, type(spec.task).__name__)
        and robot in (None, spec.robot)
        and (constraint is None or constraint in constraints)
    )


def _robots() -> list[dict[str, Any]]:
    """Return every robot, one whose files cannot be used with their first problem as a note."""
    rows = []
    for name in robot_names():
        row = {"name": name, "base": "", "joints": "", "actions": "", "licence": "", "note": ""}
        try:
            robot = load_robot(name)
        except ModelError as error:
            row["note"] = str(error).splitlines()[0]
        else:
            row |= {"base": robot.base, "joints": len(robot.joints), "actions": len(robot.actuators)}
            row["licence"] = robot.licence
        rows.append(row)
    return rows


def _terms(kind: Kind) -> list[dict[str, Any]]:
    """Return GUARD's own terms and those of installed packages, each with its first line or what is wrong with it."""
    rows = []
    for name in term_names(kind):
        try:
            what = (term_type(kind, name).__doc__ or "").strip().partition("\n")[0]
        except PluginError as error:
            what = str(error)
        rows.append({"name": name, "what": what})
    return rows


def _plugins(group: plugins.Group) -> list[dict[str, Any]]:
    return [
        {"name": name, "installed": reason is None, "note": reason or ""}
        for name, reason in plugins.available(group).items()
    ]


_LISTINGS: Final[dict[str, Callable[[], list[dict[str, Any]]]]] = {
    "robots": _robots,
    "tasks": lambda: _terms("task"),
    "constraints": lambda: _terms("constraint"),
    "algos": lambda: _plugins("guard.algorithms"),
    "backends": lambda: _plugins("guard.backends"),
}
