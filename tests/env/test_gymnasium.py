"""The environment's Gymnasium faces: spaces, infos, seeds, and what they refuse."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import guard_api.gym
from guard_api.errors import SpecError

ENV = "Goal_Point_8Hazards"


def test_passes_gymnasiums_checker(backend_name: str) -> None:
    env = gymnasium.make(f"guard_api.gym:guard/{ENV}-v0", backend=backend_name)
    with warnings.catch_warnings():
        # The checker warns of unbounded observation spaces; a velocity has no bound.
        warnings.filterwarnings("ignore", message=".*A Box observation space")
        check_env(env.unwrapped, skip_render_check=True)
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


def test_environments_without_a_seed_differ_and_can_be_repeated() -> None:
    name = f"guard_api.gym:guard/{ENV}-v0"
    envs = gymnasium.make_vec(name, num_envs=3, vectorization_mode="sync", backend="ideal")
    first, _ = envs.reset()
    assert not np.isclose(first[0], first[1]).all() and not np.isclose(first[1], first[2]).all()
    envs.close()
    for make in (guard_api.gym.GuardEnv, lambda *a, **k: guard_api.gym.GuardVectorEnv(*a, num_envs=2, **k)):
        one, other = make(ENV, backend="ideal"), make(ENV, backend="ideal")
        seed = one.np_random_seed
        assert type(seed) is int and 0 <= seed < 2**31
        assert seed == one.environment.seed
        drawn, _ = one.reset()
        assert not np.isclose(drawn, other.reset()[0]).all()
        np.testing.assert_array_equal(drawn, other.reset(seed=seed)[0])
        np.testing.assert_array_equal(drawn, make(ENV, backend="ideal", seed=seed).reset()[0])
        np.testing.assert_array_equal(one.reset()[0], other.reset()[0])
        assert one.np_random_seed == other.np_random_seed == seed
        one.reset(seed=5)
        assert one.np_random_seed == one.environment.seed == 5


def test_a_seed_is_a_natural_number() -> None:
    assert guard_api.gym.GuardEnv(ENV, backend="ideal", seed=7).np_random_seed == 7
    with pytest.raises(SpecError, match="seed is -1"):
        guard_api.gym.GuardEnv(ENV, backend="ideal", seed=-1)


def test_reset_options_are_refused_not_ignored() -> None:
    envs = guard_api.gym.GuardVectorEnv(ENV, num_envs=2, backend="ideal")
    with pytest.raises(SpecError, match="'reset_mask'"):
        envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(SpecError, match="'level'"):
        guard_api.gym.GuardEnv(ENV, backend="ideal").reset(options={"level": 3})


def test_no_step_before_the_first_reset() -> None:
    env, envs = guard_api.gym.GuardEnv(ENV, backend="ideal"), guard_api.gym.GuardVectorEnv(ENV, backend="ideal")
    for face, action in ((env, np.zeros(2)), (envs, np.zeros((1, 2)))):
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
            face.step(action)
        face.reset()
        face.step(action)
