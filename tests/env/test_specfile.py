"""Specification files: read, run, and every fault named by file and key."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guard_api.constraints import Gremlins, Hazards, Walls
from guard_api.env import make_environment
from guard_api.errors import SpecError
from guard_api.sensors.lidar import Lidar
from guard_api.spec import EnvSpec
from guard_api.suite import make_spec
from guard_api.tasks import Goal

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
    ],
)
def test_other_faults_name_the_file(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SpecError, match=message) as caught:
        make_spec(str(written(tmp_path, text)))
    assert "own.toml" in str(caught.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(SpecError, match=r"nowhere.toml: cannot be read: .*No such file"):
        make_spec("nowhere.toml")


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
