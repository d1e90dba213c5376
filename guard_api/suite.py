"""Names of environments and the specifications behind them: `{Task}_{Robot}_{N}{Constraint}`, as in GUARD.

Several constraints follow each other, as in Goal_Point_8Hazards_2Vases, and Goal_Point has none. The numbers are those
of GUARD's suite of 72 (Zhao et al. 2023, table 20, and its engine's configuration).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

from guard_api.errors import PluginError, SpecError, unknown_name
from guard_api.model.library import load_robot, robot_names
from guard_api.model.robot import RobotModel
from guard_api.safety_gym import level_names, make_level
from guard_api.scene.spec import Placement
from guard_api.sensors.lidar import Lidar
from guard_api.spec import EnvSpec, Kind, term_names, term_type
from guard_api.specfile import is_spec_file, read_spec
from guard_api.tasks import TASKS, Task
from guard_api.tasks.targets import Targets

SUITE_TASKS: Final = ("Goal", "Push", "Chase", "Defense")
SUITE_CONSTRAINTS: Final = ("Hazards", "Ghosts")
SUITE_ROBOTS: Final = ("point", "swimmer", "ant", "walker", "humanoid", "hopper", "arm3", "arm6", "drone")
SUITE_COUNT: Final = 8

HEIGHTS: Final = (0.5, 1.5)
"""Where 3-D goals, hazards, ghosts and targets are [m]."""

_NEEDS: Final = {"Button": "Buttons"}
"""Tasks about objects that a constraint places -> that constraint."""

_ROOM: Final = {"Walls": 4}
"""Constraints of which eight find no room -> how many are listed."""

_STRIDE: Final = 0.001
"""How far movers go in one environment step [m]; targets flee ten times as fast."""

_GRAMMAR: Final = re.compile(r"(?P<task>[A-Za-z]+)_(?P<robot>[A-Za-z0-9-]+)(?P<constraints>(_\d+[A-Za-z]+)*)")
_CONSTRAINT: Final = re.compile(r"_(\d+)([A-Za-z]+)")


def suite_names() -> list[str]:
    """Return the names of GUARD's suite whose robots are installed: 72 with all of them."""
    robots = [robot for robot in SUITE_ROBOTS if robot in robot_names()]
    return _names(SUITE_TASKS, robots, SUITE_CONSTRAINTS)


def known_names() -> list[str]:
    """Return a name for every task, robot and constraint, eight objects each but four walls, and Safety Gym's levels.

    Those of installed packages are among them, and none of them is imported. Any other number of objects is a name as
    well, and so are several constraints.
    """
    return _names(term_names("task"), robot_names(), term_names("constraint")) + level_names()


def make_spec(name: str) -> EnvSpec:
    """Return the specification that `name` stands for, or that the TOML file at the path `name` holds.

    Raises SpecError for a name outside the grammar or with an unknown task, robot or constraint (nearest names given),
    or with every problem of the file; PluginError for a task or constraint of a package that does not work.
    """
    if is_spec_file(name):
        return read_spec(Path(name))
    level = make_level(name)
    if level is not None:
        return level
    match = _GRAMMAR.fullmatch(name)
    if match is None:
        raise unknown_name("environment", name, known_names())
    task, counts = match["task"], [(int(n), kind) for n, kind in _CONSTRAINT.findall(match["constraints"])]
    robots = {robot.lower(): robot for robot in robot_names()}
    key = match["robot"].lower()
    try:
        if key not in robots:
            raise unknown_name("robot", key, robots)
        robot = robots[key]
        made = _TASKS[task](_of(robot)) if task in _TASKS else _made("task", task)
        constraints = tuple(_made("constraint", k, count=n, **_settings(k, _of(robot))) for n, k in counts)
    except SpecError as error:
        raise SpecError(f"environment {name!r}: {error}") from error
    standing = math.isfinite(_of(robot).reach)
    return EnvSpec(
        name=_name(task, robot, counts),
        robot=robot,
        task=made,
        constraints=constraints,
        robot_placement=Placement(locations=((0.0, 0.0),)) if standing else Placement(),
    )


def _made(kind: Kind, name: str, **settings: Any) -> Any:
    """Return the task or constraint `name`. Raises PluginError when a name does not say all that it needs."""
    term = term_type(kind, name)
    try:
        return term(**settings)
    except TypeError as error:
        alone = "by itself" if kind == "task" else "of a count"
        raise PluginError(f"{kind} {name!r} cannot be made {alone}, as a name asks for: {error}") from error


def _goal(robot: RobotModel) -> Task:
    if not robot.spatial:
        return TASKS["Goal"]()
    return TASKS["Goal"](heights=HEIGHTS, reach=robot.reach, compass_axes=3)


def _push(robot: RobotModel) -> Task:
    # The goal stays on the floor, as in GUARD's suite: there the ball lies.
    return TASKS["Push"](compass_axes=3 if robot.spatial else 2)


def _chase(robot: RobotModel) -> Task:
    return TASKS["Chase"](targets=_targets(robot, sight=3.0))


def _defense(robot: RobotModel) -> Task:
    # GUARD's suite has 2.5 m in five of the six suites of 3-D robots and forgets it in one.
    return TASKS["Defense"](targets=_targets(robot, sight=2.5 if robot.spatial else 2.0))


_TASKS: Final[dict[str, Callable[[RobotModel], Task]]] = {
    "Goal": _goal,
    "Push": _push,
    "Chase": _chase,
    "Defense": _defense,
}


def _targets(robot: RobotModel, sight: float) -> Targets:
    speed = _stride_speed(robot)
    return Targets(speed=speed, flight_speed=10.0 * speed, sight=sight, **_in_space(robot))


def _settings(kind: str, robot: RobotModel) -> dict[str, Any]:
    """Return what a constraint called `kind` needs to know of the robot."""
    if kind == "Ghosts":
        return {"speed": _stride_speed(robot), **_in_space(robot)}
    if kind == "Hazards" and robot.spatial:
        return {"reach": robot.reach, **_in_space(robot)}
    return {}


def _in_space(robot: RobotModel) -> dict[str, Any]:
    """Return the settings that make the objects of a task or constraint 3-D ones, for a robot that works in space."""
    return {"heights": HEIGHTS, "lidar": Lidar(bins=10, layers=6)} if robot.spatial else {}


def _stride_speed(robot: RobotModel) -> float:
    """Return the speed [m/s] of an object that goes one stride in an environment step of `robot`."""
    return _STRIDE / (robot.substeps * robot.timestep)


@cache
def _of(robot: str) -> RobotModel:
    return load_robot(robot)


def _names(tasks: Sequence[str], robots: Sequence[str], constraints: Sequence[str]) -> list[str]:
    return [
        _name(task, robot, [(_ROOM.get(constraint, SUITE_COUNT), constraint)])
        for task in tasks
        for robot in robots
        for constraint in constraints
        if _NEEDS.get(task, constraint) == constraint
    ]


def _name(task: str, robot: str, counts: list[tuple[int, str]]) -> str:
    """Return the one spelling of an environment's name."""
    return "_".join([task, robot.capitalize(), *(f"{count}{kind}" for count, kind in counts)])
