"""GUARD's suite: 72 names that mean what they mean in the paper, on every backend."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from guard_api.env import Environment, make_environment
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
def test_the_whole_suite(name: str, backend_name: str) -> None:
    """Built, clean for Gymnasium, 1000 random steps, the same bits twice, worlds independent of their number."""
    env = gymnasium.make(f"guard_api.gym:guard/{name}-v0", backend=backend_name)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*A Box observation space")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()
    check(name, backend_name, steps=1000)


def check(name: str, backend: str, steps: int) -> None:
    """Step two worlds twice and one of them alone, with random actions: finite, repeatable, independent."""
    tape = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, 2, ACTIONS[name.split("_")[1]]))
    first, again, alone = (rollout(name, backend, tape[:, :n]) for n in (2, 2, 1))
    for one, other, single in zip(first, again, alone, strict=True):
        assert np.isfinite(one).all()
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one[:1], single)


def rollout(name: str, backend: str, tape: np.ndarray) -> list[np.ndarray]:
    env: Environment = make_environment(name, backend=backend, num_worlds=tape.shape[1], seed=3, workers=1)
    outcome = [env.reset()]
    for action in tape:
        step = env.step(action)
        assert not step.failures
        assert (step.costs >= 0.0).all()
        outcome += [step.observation, step.reward[:, None], step.costs]
    env.close()
    return outcome
