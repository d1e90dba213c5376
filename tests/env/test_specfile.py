"""Specification files: read, run, and every fault named by file and key."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guard_api.constraints import CONSTRAINTS, Buttons, Constraint, Gremlins, Hazards, Pillars, Vases, Walls
from guard_api.env import make_environment
from guard_api.errors import SpecError
from guard_api.sensors.lidar import Lidar
from guard_api.spec import EnvSpec
from guard_api.suite import make_spec
from guard_api.tasks import TASKS, Chase, Circle, Defense, Goal, Push, Task
from guard_api.tasks.targets import Targets

EXAMPLE = Path(__file__).parents[2] / "examples" / "environment.toml"


def written(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text)
    return path


def test_the_example_is_what_it_says_and_runs() -> None:
    spec = make_spec(str(EXAMPLE))
    assert spec.name == "environment"
    assert spec.task == Goal(size=0.3)
    lidar = Lidar(bins=12, max_distance=3.0)
    assert spec.constraints == (Hazards(count=6, size=0.25, lidar=lidar), Gremlins(count=2, weight=0.5))
    assert spec.scenery == (Walls(count=3, size=0.3, keepout=0.45, locations=((0.0, 1.2), (0.0, -1.2))),)
    assert spec.robot_placement.radius == (1.0, math.inf)
    env = make_environment(str(EXAMPLE), backend="ideal", num_worlds=20)
    assert env.cost_names == ("hazards", "gremlins")
    robot = env.snapshot.position[:, :2]
    assert (robot[:, 0] <= -1.4 + 1e-9).all()
    assert (np.linalg.norm(robot, axis=1) >= 1.0 - 1e-9).all()
    assert (env.snapshot.bodies["walls"][:, 0, :2] == (0.0, 1.2)).all()
    env.close()


def test_a_file_and_python_give_the_same_fingerprint(tmp_path: Path) -> None:
    """Whole numbers stand for floating ones, and what is missing has its default."""
    path = written(tmp_path, 'robot = "point"\nextents = [-2, -2, 2, 2]\n[task]\ntype = "Goal"\nsize = 1\n')
    spec = EnvSpec(name="own", robot="point", task=Goal(size=1.0), constraints=())
    assert make_spec(str(path)) == spec
    assert make_spec(str(path)).fingerprint == spec.fingerprint


def test_every_fault_is_named_by_file_and_key(tmp_path: Path) -> None:
    text = """
        robt = "car"
        extents = [0, 1]
        [task]
        type = "Gaol"
        [[constraints]]
        type = "Hazards"
        size = "big"
        [[constraints]]
        type = "Walls"
        count = 2
        locations = [[0, 1], [2, nan]]
        lidar = { bins = 3.5 }
    """
    path = written(tmp_path, text)
    with pytest.raises(SpecError) as caught:
        make_spec(str(path))
    faults = str(caught.value).splitlines()
    assert all(fault.startswith(f"{path}: ") for fault in faults)
    assert [fault.removeprefix(f"{path}: ").split(": ")[0] for fault in faults] == [
        "robt", "robot", "task.type", "constraints[0].count", "constraints[0].size", "constraints[1].locations[1][1]",
        "constraints[1].lidar.bins", "extents",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot = \n", r"cannot be read: .*line 1"),
        (
            'robot = "point"\n[task]\ntype = "Button"\n',
            r"own.toml: environment 'own': goal: onto: .*constraint Buttons",
        ),
        ('robot = "point"\n', r"own.toml: task: is missing"),
        ('robot = "point"\n[task]\ntype = "Goal"\nsize = -0.3\n', r"own.toml: environment 'own': Goal.size is -0.3"),
        ('robot = "point"\n[task]\ntype = "Circle"\nlidar.bins = 0\n', r"own.toml: Lidar.bins is 0: it must be"),
    ],
)
def test_other_faults_name_the_file(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SpecError, match=message) as caught:
        make_spec(str(written(tmp_path, text)))
    assert "own.toml" in str(caught.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(SpecError, match=r"nowhere.toml: cannot be read: .*No such file"):
        make_spec("nowhere.toml")


def of(task: Task, *constraints: Constraint, scenery: tuple[Constraint, ...] = ()) -> EnvSpec:
    return EnvSpec(name="own", robot="point", task=task, constraints=constraints, scenery=scenery)


@pytest.mark.parametrize(
    ("task", "constraint", "message"),
    [
        (Goal(size=-0.3), None, r"Goal.size is -0.3: it must be a finite number above 0"),
        (Goal(size=math.inf), None, r"Goal.size is inf"),
        (Goal(compass_axes=5), None, r"Goal.compass_axes is 5: it must be a whole number from 2 to 3"),
        (Circle(radius=0.0), None, r"Circle.radius is 0.0"),
        (Circle(bonus=True), None, r"Circle.bonus is True: it must be a finite number"),
        (Defense(radius=-1.0), None, r"Defense.radius is -1.0"),
        (Chase(targets=Targets(speed=-1.0)), None, r"Chase.targets.speed is -1.0"),
        (Chase(targets=Targets(count=0)), None, r"Chase.targets.count is 0: it must be a whole number of at least 1"),
        (Push(reach=-0.1), None, r"Push.reach is -0.1: it must be a number of at least 0"),
        (Goal(), Hazards(count=1, weight=-1.0), r"Hazards.weight is -1.0: it must be a finite number of at least 0"),
        (Goal(), Gremlins(count=1, weight=-1.0), r"Gremlins.weight is -1.0"),
        (Goal(), Pillars(count=1, size=0), r"Pillars.size is 0"),
        (Goal(), Vases(count=1, density=0.0), r"Vases.density is 0.0"),
        (Goal(), Buttons(count=1, keepout="wide"), r"Buttons.keepout is 'wide'"),  # pyright: ignore[reportArgumentType]
    ],
)
def test_numbers_that_mean_nothing_are_refused_by_term_and_field(
    task: Task, constraint: Constraint | None, message: str
) -> None:
    with pytest.raises(SpecError, match=f"^environment 'own': {message}"):
        of(task, *([constraint] if constraint else []))
    if constraint:
        with pytest.raises(SpecError, match=message):
            of(task, scenery=(constraint,))


def scene_of(term: Any) -> EnvSpec:
    buttons = (Buttons(count=2),) if type(term).__name__ == "Button" else ()
    return of(term, *buttons) if isinstance(term, Task) else of(Goal(), term)


TERMS = [*(task() for task in TASKS.values()), *(constraint(count=1) for constraint in CONSTRAINTS.values())]


@pytest.mark.parametrize("term", [*TERMS, Targets()], ids=lambda term: type(term).__name__)
def test_no_number_of_any_term_may_be_nan_and_only_rewards_may_be_negative(term: Any) -> None:
    def specified(**values: Any) -> EnvSpec:
        changed = replace(term, **values)
        return scene_of(Chase(targets=changed) if isinstance(term, Targets) else changed)

    numbers = [f.name for f in fields(term) if type(getattr(term, f.name)) in (int, float)]
    specified()
    assert numbers
    for name in numbers:
        with pytest.raises(SpecError):
            specified(**{name: math.nan})
        if name not in ("bonus", "scale"):
            with pytest.raises(SpecError):
                specified(**{name: -1})


def test_zero_weights_and_unlimited_distances_are_allowed() -> None:
    vases = Vases(count=1, contact_weight=0.0, velocity_threshold=math.inf)
    of(Chase(targets=Targets(sight=math.inf, speed=0.0), bonus=-1.0), vases, Hazards(count=0, keepout=0.0))


def test_terms_that_declare_no_limits_are_not_checked() -> None:
    """Those of users' packages: a name such as `weight` may mean something else there."""

    @dataclass(frozen=True, kw_only=True)
    class Puddles(Hazards):
        weight: float = -1.0
        size: Any = "narrow"

        def objects(self) -> Any:
            return Hazards(count=self.count).objects()

    of(Goal(), Puddles(count=1))


def test_a_scene_holds_a_bounded_number_of_things() -> None:
    of(Goal(), Hazards(count=999))
    with pytest.raises(SpecError, match=r"hazards: count is 600: a scene may hold 1000 things in all, not 1101"):
        of(Goal(), Pillars(count=500), Hazards(count=600))


anything = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.just(10**400) | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)
FIELDS = sorted(make_spec("Goal_Point_8Hazards").to_json())


@given(field=st.sampled_from(FIELDS), part=st.sampled_from(["", "task", "robot_placement"]), value=anything)
def test_whatever_stands_in_a_field_is_read_or_refused(field: str, part: str, value: object) -> None:
    """No other error than GUARD's own leaves the reader, and what it reads is written back the same."""
    data = make_spec("Goal_Point_8Hazards").to_json()
    if part:
        data[part] = {**data[part], sorted(data[part])[len(field) % len(data[part])]: value}
    else:
        data[field] = value
    try:
        spec = EnvSpec.from_json(data)
    except SpecError:
        return
    assert EnvSpec.from_json(json.loads(json.dumps(spec.to_json()))) == spec
