"""Names of environments and the specifications behind them: `{Task}_{Robot}_{N}{Constraint}`, as in GUARD."""

from __future__ import annotations

import re
from typing import Final

from guard_api.constraints import CONSTRAINTS
from guard_api.errors import SpecError, unknown_name
from guard_api.model.library import robot_names
from guard_api.spec import EnvSpec
from guard_api.tasks import TASKS

_GRAMMAR: Final = re.compile(r"(?P<task>[A-Za-z]+)_(?P<robot>[A-Za-z0-9_-]+)_(?P<count>\d+)(?P<constraint>[A-Za-z]+)")

_MAX_COUNT: Final = 8
"""Objects in the named suite; any other number works too."""


def known_names() -> list[str]:
    """Return the environment names of the suite: every task with every robot and eight objects of every constraint."""
    return [
        _name(task, robot, _MAX_COUNT, constraint)
        for task in TASKS
        for robot in robot_names()
        for constraint in CONSTRAINTS
    ]


def make_spec(name: str) -> EnvSpec:
    """Return the specification that `name` stands for.

    Raises SpecError for a name outside the grammar or with an unknown task, robot or constraint (nearest names given).
    """
    match = _GRAMMAR.fullmatch(name)
    if match is None:
        raise unknown_name("environment", name, known_names())
    task, count, constraint = match["task"], int(match["count"]), match["constraint"]
    robots = {robot.lower(): robot for robot in robot_names()}
    robot = match["robot"].lower()
    for kind, value, known in (
        ("task", task, TASKS),
        ("robot", robot, robots),
        ("constraint", constraint, CONSTRAINTS),
    ):
        if value not in known:
            error = unknown_name(kind, value, known)
            raise SpecError(f"environment {name!r}: {error}")
    return EnvSpec(
        name=_name(task, robots[robot], count, constraint),
        robot=robots[robot],
        task=TASKS[task](),
        constraints=(CONSTRAINTS[constraint](count=count),),
    )


def _name(task: str, robot: str, count: int, constraint: str) -> str:
    """Return the one spelling of an environment's name."""
    return f"{task}_{robot.capitalize()}_{count}{constraint}"
