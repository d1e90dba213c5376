"""The environment on every installed backend: what GUARD promises to whoever trains in it."""

from __future__ import annotations

import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import guard_api.gym
from guard_api.env import FAILURE_COST, FAILURE_REWARD, Environment, make_environment
from guard_api.errors import SpecError
from guard_api.suite import make_spec

ENV = "Goal_Point_8Hazards"

LAYOUT = {
    "accelerometer": slice(0, 3), "goal_compass": slice(3, 5), "gyro": slice(5, 8), "hazards_lidar": slice(8, 24),
    "magnetometer": slice(24, 27), "velocimeter": slice(27, 30),
}  # fmt: skip
"""The observation of GUARD's Goal_Point_8Hazards: names sorted, 30 numbers."""


def actions(num_worlds: int, steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, num_worlds, 2))


def rollout(env: Environment, tape: np.ndarray) -> list[np.ndarray]:
    outcome = [env.reset()]
    for action in tape:
        step = env.step(action)
        outcome += [step.observation, step.reward, step.costs, step.truncated]
    return outcome


def test_observation_is_guards(backend_name: str) -> None:
    env = make_environment(ENV, backend=backend_name, num_worlds=2)
    assert env.observation_layout == LAYOUT
    assert env.reset().shape == (2, 30)
    assert env.cost_names == ("hazards",)
    env.close()


def test_passes_gymnasiums_checker(backend_name: str) -> None:
    env = gymnasium.make(f"guard_api.gym:guard/{ENV}-v0", backend=backend_name)
    with warnings.catch_warnings():
        # The checker warns of unbounded observation spaces; a velocity has no bound.
        warnings.filterwarnings("ignore", message=".*A Box observation space")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


def test_reaches_guards_speeds(backend_name: str) -> None:
    """GUARD's Point: 1.50 m/s at action (1, 0) and 3.0 rad/s at (0, 1), within 1 %."""
    env = make_environment(ENV, backend=backend_name, num_worlds=2)
    env.reset()
    for _ in range(200):
        observation = env.step(np.array([[1.0, 0.0], [0.0, 1.0]])).observation
    assert observation[0, LAYOUT["velocimeter"]][0] == pytest.approx(1.5, rel=0.01)
    assert observation[1, LAYOUT["gyro"]][2] == pytest.approx(3.0, rel=0.01)
    env.close()


def test_same_seed_same_bits_and_worlds_independent_of_their_number(backend_name: str) -> None:
    tape = actions(5, 30)
    runs = []
    for worlds in (5, 5, 1):
        env = make_environment(ENV, backend=backend_name, num_worlds=worlds, seed=3, workers=1)
        runs.append(rollout(env, tape[:, :worlds]))
        env.close()
    for run in runs[1:]:
        for one, other in zip(runs[0], run, strict=True):
            np.testing.assert_array_equal(one[: len(other)], other)


def test_starts_are_the_same_on_every_backend(backend_name: str) -> None:
    reference = make_environment(ENV, backend="ideal", num_worlds=3, seed=5)
    env = make_environment(ENV, backend=backend_name, num_worlds=3, seed=5)
    for episode in (0, 1, 7):
        np.testing.assert_allclose(env.reset(episode), reference.reset(episode), atol=1e-6)
    reference.close()
    env.close()


def test_starts_differ_between_worlds_episodes_and_seeds() -> None:
    env = make_environment(ENV, backend="ideal", num_worlds=2)
    first, second, other_seed = env.reset(0), env.reset(1), env.reset(0, seed=1)
    assert not np.isclose(first[0], first[1]).all()
    assert not np.isclose(first, second).all()
    assert not np.isclose(first, other_seed).all()
    np.testing.assert_array_equal(env.reset(0, seed=0), first)


def test_episode_is_truncated_not_terminated_and_its_last_observation_is_right(backend_name: str) -> None:
    assert make_spec(ENV).episode_length == 1000
    spec = replace(make_spec(ENV), episode_length=30)
    env = make_environment(spec, backend=backend_name, num_worlds=2, seed=1)
    tape = actions(2, 30)
    env.reset()
    for i, action in enumerate(tape):
        step = env.step(action)
        assert step.truncated.all() == (i == env.episode_length - 1)
        assert not step.terminated.any()
    # The same episode again, stopped one step earlier, shows what the last observation must be.
    twin = make_environment(replace(spec, episode_length=31), backend=backend_name, num_worlds=2, seed=1)
    twin.reset()
    for action in tape:
        true_last = twin.step(action).observation
    np.testing.assert_array_equal(step.final_observation, true_last)
    np.testing.assert_array_equal(step.observation, twin.reset(episode=1))
    env.close()
    twin.close()


def test_a_diverged_world_ends_its_own_episode_only(backend_name: str) -> None:
    env = make_environment(ENV, backend=backend_name, num_worlds=3, seed=2)
    calm = make_environment(ENV, backend=backend_name, num_worlds=3, seed=2)
    env.reset()
    calm.reset()
    tape = actions(3, 20)
    for i, action in enumerate(tape):
        poisoned = action.copy()
        if i == 5:
            poisoned[1] = np.nan
        step, expected = env.step(poisoned), calm.step(action)
        for mine, theirs in ((step.observation, expected.observation), (step.reward, expected.reward)):
            np.testing.assert_array_equal(mine[[0, 2]], theirs[[0, 2]])
        if i == 5:
            assert step.terminated.tolist() == [False, True, False]
            assert "diverged" in step.failures[1]
            assert step.reward[1] == FAILURE_REWARD
            assert step.costs[1, 0] == FAILURE_COST
        assert np.isfinite(step.observation).all()
        assert np.isfinite(step.final_observation).all()
    env.close()
    calm.close()


def test_reached_goal_pays_and_moves(backend_name: str) -> None:
    """A proportional controller that turns to the compass and drives reaches goal after goal."""
    env = make_environment(ENV, backend=backend_name, num_worlds=4, seed=0)
    observation = env.reset()
    reached = np.zeros(4)
    for _ in range(600):
        bearing = observation[:, LAYOUT["goal_compass"]]
        turn = np.clip(2.0 * np.arctan2(bearing[:, 1], bearing[:, 0]), -1, 1)
        drive = np.where(bearing[:, 0] > 0.7, 1.0, 0.0)
        before = env.step(np.stack([drive, turn], axis=1))
        assert (before.reward[before.success] > 0.9).all()
        reached += before.success
        observation = before.observation
        if (reached >= 2).all():
            break
    assert (reached >= 2).all()
    env.close()


def test_vector_face(backend_name: str) -> None:
    envs = gymnasium.make_vec(f"guard_api.gym:guard/{ENV}-v0", num_envs=3, backend=backend_name)
    observation, _ = envs.reset(seed=4)
    assert observation in envs.observation_space
    envs.unwrapped.environment.episode_length = 2
    envs.step(envs.action_space.sample())
    observation, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
    assert reward.shape == (3,)
    assert truncated.all()
    assert not terminated.any()
    assert info["_final_obs"].all()
    assert np.stack(info["final_obs"]).shape == observation.shape
    assert not np.isclose(np.stack(info["final_obs"]), observation).all()
    assert info["final_info"]["cost"].shape == (3,)
    assert info["cost"].shape == (3,)
    assert set(info["costs"]) == {"hazards"}
    envs.close()


def test_observations_come_by_name_too() -> None:
    flat, named = (guard_api.gym.GuardEnv(ENV, backend="ideal", observations=form) for form in ("flat", "dict"))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*A Box observation space")
        check_env(named, skip_render_check=True)
    array, readings = flat.reset(seed=3)[0], named.reset(seed=3)[0]
    assert isinstance(readings, dict)
    np.testing.assert_array_equal(np.concatenate(list(readings.values())), array)
    assert readings["goal_compass"].shape == (2,)
    with pytest.raises(SpecError, match="observations is 'tuple'"):
        guard_api.gym.GuardEnv(ENV, backend="ideal", observations="tuple")

    envs = guard_api.gym.GuardVectorEnv(ENV, num_envs=2, backend="ideal", observations="dict")
    observation, _ = envs.reset(seed=4)
    assert observation in envs.observation_space
    envs.environment.episode_length = 1
    _, _, _, truncated, info = envs.step(envs.action_space.sample())
    assert truncated.all()
    assert info["final_obs"][1] in envs.single_observation_space
    envs.close()


def test_single_face_says_cost_and_refuses_to_step_past_the_end() -> None:
    env = guard_api.gym.SafetyAdapter(guard_api.gym.GuardEnv(ENV, backend="ideal"))
    env.reset(seed=0)
    env.unwrapped.environment.episode_length = 1
    _, _, cost, terminated, truncated, info = env.step(np.zeros(2))
    assert cost == info["cost"] == sum(info["costs"].values())
    assert (terminated, truncated) == (False, True)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2))
    env.close()


def test_gymnasium_reset_seeds_and_continues() -> None:
    env = guard_api.gym.GuardEnv(ENV, backend="ideal")
    first, _ = env.reset(seed=9)
    second, _ = env.reset()
    again, _ = env.reset(seed=9)
    np.testing.assert_array_equal(first, again)
    assert not np.isclose(first, second).all()


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"env": "Gaol_Point_8Hazards"}, "did you mean Goal"),
        ({"env": "Goal_Pint_8Hazards"}, "did you mean point"),
        ({"env": "nonsense"}, "unknown environment"),
        ({"env": ENV, "backend": "mujocco"}, "did you mean mujoco"),
        ({"env": ENV, "num_worlds": 0}, "num_worlds is 0"),
        ({"env": ENV, "seed": -1}, "seed is -1"),
        ({"env": "Goal_Point_60Hazards"}, "fewer objects"),
    ],
)
def test_wrong_requests_get_one_clear_line(kwargs: dict, message: str) -> None:
    with pytest.raises(SpecError, match=message) as caught:
        make_environment(**{"backend": "ideal", **kwargs})
    assert "\n" not in str(caught.value)


def test_wrong_action_shape_is_refused() -> None:
    env = make_environment(ENV, backend="ideal", num_worlds=2)
    with pytest.raises(SpecError, match=r"expected \(2, 2\)"):
        env.step(np.zeros((3, 2)))
