"""Specifications: JSON round trip, fingerprints, and names."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from guard_api.constraints import Hazards
from guard_api.errors import SpecError
from guard_api.scene.spec import Placement
from guard_api.spec import EnvSpec
from guard_api.suite import known_names, make_spec
from guard_api.tasks import Goal


def test_round_trip_keeps_the_fingerprint() -> None:
    for name in known_names():
        spec = make_spec(name)
        again = EnvSpec.from_json(json.loads(json.dumps(spec.to_json())))
        assert again == spec
        assert again.fingerprint == spec.fingerprint


def test_any_change_changes_the_fingerprint() -> None:
    spec = make_spec("Goal_Point_8Hazards")
    others = [
        make_spec("Goal_Point_7Hazards"),
        replace(spec, preset="native"),
        replace(spec, task=Goal(size=0.3)),
        replace(spec, constraints=(Hazards(count=8, size=0.2),)),
        replace(spec, episode_length=500),
    ]
    assert len({spec.fingerprint, *(other.fingerprint for other in others)}) == 6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"taks": 1}, "did you mean task"),
        ({"task": {"type": "Gaol"}}, "did you mean Goal"),
        ({"task": {"type": "Goal", "siez": 1}}, "siez"),
        ({"constraints": [{"type": "Hazard", "count": 8}]}, "did you mean Hazards"),
        ({"constraints": [{"type": "Hazards", "count": 8}] * 2}, "two parts place 'hazards'"),
        ({"constraints": [{"type": "Hazards", "count": -1}]}, "hazards: count is -1"),
        ({"episode_length": 0}, "episode_length is 0"),
        ({"episode_length": "abc"}, "episode_length: 'abc' is not a whole number"),
        ({"preset": "bogus"}, "preset: unknown value 'bogus'"),
        ({"extents": [2, 2, -2, -2]}, "extents"),
        ({"task": "Goal"}, "task: 'Goal' is not a table"),
        ({"task": {"type": "Goal", "size": "big"}}, "task.size: 'big' is not a number"),
        ({"task": {"type": "Goal", "size": True}}, "task.size: True is not a number"),
        ({"graded": 1}, "graded: 1 is not true or false"),
        ({"constraints": [{"type": "Hazards"}]}, r"constraints\[0\].count: is missing"),
        ({"constraints": [{"type": "Hazards", "count": 1, "lidar": {"bin": 3}}]}, "did you mean bins"),
        ({"constraints": {"type": "Hazards"}}, "constraints: .* is not a list"),
    ],
)
def test_malformed_specs_are_refused_by_field(change: dict, message: str) -> None:
    data = {**make_spec("Goal_Point_8Hazards").to_json(), **change}
    with pytest.raises(SpecError, match=message):
        EnvSpec.from_json(data)


def test_a_name_has_one_spelling() -> None:
    spec = make_spec("Goal_Point_8Hazards")
    for other in ("Goal_point_8Hazards", "Goal_Point_08Hazards"):
        assert make_spec(other) == spec


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"robot_placement": {"clearance": 1.0}}, "robot_placement.clearance: says nothing"),
        ({"robot_placement": {"locations": [[0, 0], [1, 1]]}}, "robot_placement.locations: 2 of them for 1"),
        (
            {"robot_placement": {"rectangles": [[0, 0, -1, 1]]}},
            r"robot_placement.rectangles: \(0.0, 0.0, -1.0, 1.0\) is not",
        ),
        ({"robot_placement": {"radius": [2, 1]}}, r"robot_placement.radius: \(2.0, 1.0\) is not"),
        ({"task": {"type": "Goal", "heights": [1.5, 0.5]}}, r"goal: heights: \(1.5, 0.5\) is not"),
        ({"task": {"type": "Goal", "reach": -1.0}}, "goal: distance: -1.0"),
        ({"task": {"type": "Button"}}, "goal: onto: nothing places 'buttons': add the constraint Buttons"),
        (
            {"task": {"type": "Button"}, "constraints": [{"type": "Buttons", "count": 0}]},
            "goal: onto: 0 buttons are too few",
        ),
        (
            {"constraints": [{"type": "Walls", "count": 1, "locations": [[0, 0], [1, 1]]}]},
            "walls: locations: 2 of them",
        ),
        (
            {"constraints": [{"type": "Walls", "count": 1, "locations": [[0]]}]},
            r"constraints\[0\].locations\[0\]: \[0\] has 1 entries",
        ),
        ({"constraints": [{"type": "Hazards", "count": 8.0}]}, r"constraints\[0\].count: 8.0 is not a whole number"),
        ({"extents": [0, 0, 1]}, r"extents: \[0, 0, 1\] has 3 entries"),
    ],
)
def test_placements_that_mean_nothing_are_refused_by_field(part: dict, message: str) -> None:
    data = {**make_spec("Goal_Point_8Hazards").to_json(), **part}
    with pytest.raises(SpecError, match=message) as caught:
        EnvSpec.from_json(data)
    assert str(caught.value).startswith(("environment 'Goal_Point_8Hazards'", "environment spec 'Goal_Point_8Hazards'"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"extents": (0, 0, 1)}, r"extents: \(0, 0, 1\) are not"),
        ({"constraints": (Hazards(count=8.0),)}, "hazards: count is 8.0"),
        ({"robot_placement": Placement(locations=((0.0,),))}, r"robot_placement.locations: \(0.0,\) is not"),
        ({"robot_placement": Placement(radius=(0.0, float("nan")))}, "robot_placement.radius"),
        ({"episode_length": 2.5}, "episode_length is 2.5"),
    ],
)
def test_specifications_made_in_python_are_checked_too(change: dict, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        replace(make_spec("Goal_Point_8Hazards"), **change)
