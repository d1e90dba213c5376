"""Safety Gym's levels: what they place, observe and cost, on every backend."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.env import make_environment
from guard_api.errors import SpecError
from guard_api.safety_gym import level_names
from guard_api.suite import make_spec
from tests.env.staging import drive, put

POINT = 12
"""Numbers of the Point's own observation; every lidar has 16."""

LIDARS = {"Goal": ("goal",), "Button": ("goal", "buttons"), "Push": ("goal", "box")}
OTHERS = {
    "Goal": ((), ("hazards", "vases"), ("hazards", "vases")),
    "Button": ((), ("hazards", "gremlins"), ("hazards", "gremlins")),
    "Push": ((), ("hazards", "pillars"), ("hazards", "pillars")),
}
COSTS = {
    "Goal": ((), ("hazards",), ("hazards", "vases")),
    "Button": ((), ("buttons", "hazards", "gremlins"), ("buttons", "hazards", "gremlins")),
    "Push": ((), ("hazards",), ("hazards", "pillars")),
}


def test_there_are_27_levels() -> None:
    assert len(level_names()) == len(set(level_names())) == 27


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("task", ["Goal", "Button", "Push"])
def test_levels_observe_and_cost_what_safety_gyms_do(task: str, level: int) -> None:
    env = make_environment(f"Point{task}{level}", backend="ideal", num_worlds=2)
    expected = {f"{name}_lidar" for name in (*LIDARS[task], *OTHERS[task][level])}
    assert {name for name in env.observation_layout if "lidar" in name or "compass" in name} == expected
    assert env.observation_size == POINT + 16 * len(expected)
    assert env.cost_names == COSTS[task][level]
    rewards, costs = drive(env, (1.0, 0.3), 20)
    assert np.isfinite(rewards).all()
    assert costs.shape == (20, 2, len(COSTS[task][level]))
    env.close()


def test_counts_and_areas_are_safety_gyms() -> None:
    spec = make_spec("DoggoButton2")
    assert {group.name: group.count for group in spec.groups} == {"goal": 1, "buttons": 4, "hazards": 8, "gremlins": 6}
    assert spec.extents == (-1.8, -1.8, 1.8, 1.8)
    assert make_spec("CarPush0").task.object_size == 0.125
    assert make_spec("PointPush0").task.object_size == 0.2


def test_costs_are_indicators_and_scenery_costs_nothing(backend_name: str) -> None:
    env = make_environment("PointGoal1", backend=backend_name, num_worlds=2, workers=1)
    ring = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(1.0, 5.0, 7)])
    hazards = np.concatenate([np.array([[0.6, 0.0]]), 3.0 * ring])[None]
    beside = hazards.copy()
    beside[0, 0, 1] = 0.21
    put(env, np.zeros((1, 2)), goal=np.array([[9.0, 9.0]]), hazards=np.concatenate([hazards, beside]),
        vases=np.array([[[0.2, 0.0]]]))  # fmt: skip
    _, costs = drive(env, (1.0, 0.0), 80)
    assert set(np.unique(costs[:, 0])) == {0.0, 1.0}
    assert not costs[:, 1].any()
    env.close()


def test_pressing_the_lit_button_pays_and_the_next_one_lights_up(backend_name: str) -> None:
    env = make_environment("PointButton1", backend=backend_name, num_worlds=2, workers=1)
    if not env.world.scene.num_bodies or backend_name == "ideal":
        pytest.skip("the backend has no contacts")
    buttons = np.array([[[0.6, 0.0], [0.0, 1.4], [0.0, -1.4], [-1.4, 0.0]]])
    goals = np.array([[[0.6, 0.0]], [[0.0, 1.4]]])
    far = np.array([[[5.0 + i, 5.0] for i in range(4)]])
    put(env, np.zeros((1, 2)), goal=goals, buttons=buttons, hazards=far, gremlins=far)
    rewards, costs = drive(env, (1.0, 0.0), 60)
    wrong = costs[..., env.cost_names.index("buttons")]
    assert rewards[:, 0].max() > 0.9  # world 0 runs into the lit button, world 1 into a dark one
    assert rewards[:, 1].max() < 0.1
    assert wrong[:, 1].any()
    pressed = int(rewards[:, 0].argmax())
    assert not wrong[: pressed + 11, 0].any()
    env.close()


def test_a_level_that_does_not_exist_is_unknown() -> None:
    with pytest.raises(SpecError, match="PointGoal"):
        make_spec("PointGoal3")
