"""`guard list`: what there is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import tyro

from guard_api import plugins
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.constraints import CONSTRAINTS
from guard_api.model.library import load_robot, robot_names
from guard_api.suite import known_names, make_spec
from guard_api.tasks import TASKS

Kind = Literal["envs", "robots", "tasks", "constraints", "algos", "backends"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What to list, and how."""

    kind: Annotated[Kind, tyro.conf.Positional] = "envs"
    """What to list."""
    json: bool = False
    """Print JSON instead of a table."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "list", argv, "Show what there is to use.")
    rows = _LISTINGS[options.kind]()
    if options.json:
        print_json(rows)
    else:
        columns = list(rows[0]) if rows else ["name"]
        print_table(options.kind, columns, ([row[column] for column in columns] for row in rows))
    return 0


def _envs() -> list[dict[str, Any]]:
    rows = []
    for name in known_names():
        spec = make_spec(name)
        constraints = " ".join(constraint.name for constraint in spec.constraints)
        task = type(spec.task).__name__
        rows.append({"name": name, "robot": spec.robot, "task": task, "constraints": constraints})
    return rows


def _robots() -> list[dict[str, Any]]:
    robots = [load_robot(name) for name in robot_names()]
    return [
        {"name": r.name, "base": r.base, "joints": len(r.joints), "actions": len(r.actuators), "licence": r.licence}
        for r in robots
    ]


def _terms(table: dict[str, type]) -> list[dict[str, Any]]:
    return [{"name": name, "what": (term.__doc__ or "").strip().splitlines()[0]} for name, term in table.items()]


def _plugins(group: plugins.Group) -> list[dict[str, Any]]:
    return [
        {"name": name, "installed": reason is None, "note": reason or ""}
        for name, reason in plugins.available(group).items()
    ]


_LISTINGS: Final[dict[str, Callable[[], list[dict[str, Any]]]]] = {
    "envs": _envs,
    "robots": _robots,
    "tasks": lambda: _terms(TASKS),
    "constraints": lambda: _terms(CONSTRAINTS),
    "algos": lambda: _plugins("guard.algorithms"),
    "backends": lambda: _plugins("guard.backends"),
}
