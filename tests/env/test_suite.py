"""GUARD's suite: 72 names that mean what they mean in the paper, on every backend."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from guard_api.env import Environment, make_environment
from guard_api.errors import SpecError
from guard_api.suite import SUITE_ROBOTS, make_spec, suite_names

ROBOTS = ("Point", "Swimmer", "Ant", "Walker", "Humanoid", "Hopper", "Arm3", "Arm6", "Drone")

OBSERVATIONS = {
    "Goal": dict(zip(ROBOTS, (30, 40, 62, 62, 56, 49, 259, 355, 83), strict=True)),
    "Push": dict(zip(ROBOTS, (32, 42, 64, 64, 58, 51, 268, 367, 86), strict=True)),
    "Chase": dict(zip(ROBOTS, (44, 54, 76, 76, 70, 63, 430, 583, 140), strict=True)),
}
"""Sizes of GUARD's observations; Defense is observed like Chase, ghosts like hazards."""

ACTIONS = dict(zip(ROBOTS, (2, 2, 8, 10, 8, 6, 3, 6, 4), strict=True))

STEP = dict(zip(ROBOTS, (0.02, 0.2, 0.2, 0.05, 0.03, 0.05, 0.02, 0.02, 0.08), strict=True))
"""Simulated time of GUARD's environment steps [s]."""

SAMPLE = [
    "Goal_Arm3_8Ghosts", "Push_Ant_8Hazards", "Chase_Drone_8Hazards", "Defense_Swimmer_8Ghosts", "Push_Point_8Ghosts",
    "Goal_Humanoid_8Ghosts",
]  # fmt: skip


def test_the_suite_has_72_names() -> None:
    assert len(suite_names()) == len(set(suite_names())) == 72
    assert len(SUITE_ROBOTS) == 9


def test_sizes_and_steps_are_guards() -> None:
    wrong = {}
    for name in suite_names():
        task, robot, _ = name.split("_")
        env = make_environment(name, backend="ideal")
        expected = OBSERVATIONS["Chase" if task == "Defense" else task][robot]
        if (env.observation_size, env.action_size) != (expected, ACTIONS[robot]):
            wrong[name] = (env.observation_size, env.action_size)
        assert env.duration == pytest.approx(STEP[robot]), name
        env.close()
    assert not wrong


def test_movers_go_guards_way_per_step() -> None:
    for robot, step in STEP.items():
        task = make_spec(f"Chase_{robot}_8Ghosts").task
        assert task.targets.speed * step == pytest.approx(0.001)
        assert task.targets.flight_speed * step == pytest.approx(0.01)


@pytest.mark.parametrize("name", SAMPLE)
def test_a_sample_of_the_suite(name: str, backend_name: str) -> None:
    check(name, backend_name, steps=20)


@pytest.mark.slow
@pytest.mark.parametrize("name", suite_names())
def test_the_whole_suite(name: str, backend_name: str, suite_table: Path | None) -> None:
    """Clean for Gymnasium, 1000 random steps, same seed same bits, worlds independent of their number.

    With `--suite-table FILE` what holds is added to FILE, and what is in FILE already is not checked again.
    """
    if suite_table is not None and (name, backend_name) in {(row["env"], row["backend"]) for row in rows(suite_table)}:
        pytest.skip(f"is in {suite_table} already")
    env = gymnasium.make(f"guard_api.gym:guard/{name}-v0", backend=backend_name)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*A Box observation space")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()
    row = {"env": name, "backend": backend_name, "check_env": True, **check(name, backend_name, steps=1000)}
    if suite_table is not None:
        suite_table.parent.mkdir(parents=True, exist_ok=True)
        with suite_table.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def check(name: str, backend: str, steps: int) -> dict[str, Any]:
    """Step two worlds, and one world of an environment built anew, with the same random actions.

    Everything is finite, no world fails, no cost is negative, and the first world gives the same bits both times: that
    is repeatability and independence of the number of worlds at once.
    """
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, 2, ACTIONS[name.split("_")[1]]))
    both, alone = (rollout(name, backend, actions[:, :num_worlds]) for num_worlds in (2, 1))
    for one, single in zip(both, alone, strict=True):
        assert np.isfinite(one).all()
        np.testing.assert_array_equal(one[:1], single)
    return {"observation": both[0].shape[1], "steps": steps, "repeatable": True, "independent": True}


def rollout(name: str, backend: str, actions: np.ndarray) -> list[np.ndarray]:
    env: Environment = make_environment(name, backend=backend, num_worlds=actions.shape[1], seed=3, workers=1)
    outcome = [env.reset()]
    for action in actions:
        step = env.step(action)
        assert not step.failures
        assert (step.costs >= 0.0).all()
        outcome += [step.observation, step.reward[:, None], step.costs]
    env.close()
    return outcome


@pytest.fixture
def suite_table(request: pytest.FixtureRequest) -> Path | None:
    return request.config.getoption("--suite-table")


def rows(table: Path) -> list[dict[str, Any]]:
    """The rows that have been added to a table so far."""
    return [json.loads(line) for line in table.read_text(encoding="utf-8").splitlines()] if table.exists() else []


def test_a_name_without_constraints_has_no_costs() -> None:
    env = make_environment("Goal_Point", backend="ideal", num_worlds=2)
    assert env.cost_names == ()
    assert env.step(np.zeros((2, 2))).costs.shape == (2, 0)
    env.close()
    for wrong in ("Goal", "Goal_Point_", "Goal_Point_8"):
        with pytest.raises(SpecError, match=f"unknown environment '{wrong}'"):
            make_spec(wrong)
