"""Evaluation: exactly the episodes asked for, the same ones everywhere, and failures counted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from guard_api.errors import RunError
from guard_api.measure.rollout import EpisodeTable, RandomPolicy, evaluate
from tests.measure.toy_environment import LENGTH, Push, ToyEnvironment


def start(seed: int, world: int, episode: int) -> float:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(world, episode))).uniform(-0.5, 0.5)


@pytest.mark.parametrize("episodes", [1, 3, 4, 10])
def test_row_e_is_episode_e_div_n_of_world_e_mod_n(episodes: int):
    table = evaluate(Push(1.0), ToyEnvironment(num_worlds=4, seed=7), episodes)
    assert table.episodes == episodes
    x = [start(7, e % 4, e // 4) + 0.1 * np.arange(1, LENGTH + 1) for e in range(episodes)]
    np.testing.assert_allclose(table.costs[:, 0], [np.maximum(path - 1.0, 0.0).sum() for path in x])
    np.testing.assert_allclose(table.violation, [(path > 1.0).mean() for path in x])
    np.testing.assert_array_equal(table.goals, [(path > 0.5).sum() for path in x])
    np.testing.assert_allclose(table.returns, 0.1 * LENGTH)
    np.testing.assert_array_equal(table.length, LENGTH)
    assert table.success.all()
    assert not table.failed.any()


def test_the_same_call_gives_the_same_bits_after_other_use():
    env = ToyEnvironment(seed=1)
    first = evaluate(Push(0.7), env, 6, seed=5)
    evaluate(Push(-0.2), env, 3, seed=9)
    again = evaluate(Push(0.7), env, 6, seed=5)
    assert first.to_json() == again.to_json()


def test_a_diverged_episode_is_charged_for_the_steps_it_missed():
    env = ToyEnvironment(num_worlds=2, diverge={(1, 0, 5)})
    table = evaluate(Push(0.0), env, 4)
    assert table.failures == {1: "diverged"}
    np.testing.assert_array_equal(table.failed, [False, True, False, False])
    assert table.length[1] == 5
    assert table.returns[1] == -10.0
    np.testing.assert_array_equal(table.costs[1], [LENGTH - 5 + 1, LENGTH - 5 + 1])
    assert table.violation[1] == (LENGTH - 5 + 1) / LENGTH
    assert not table.success[1]
    np.testing.assert_array_equal(table.cost[[0, 2, 3]], 0.0)
    assert table.length[3] == LENGTH  # the next episode of the failed world is a whole one


def test_a_nan_policy_fails_every_episode_and_looks_unsafe():
    table = evaluate(Push(float("nan")), ToyEnvironment(), 6)
    assert table.failed.all()
    assert set(table.failures.values()) == {"the policy's action was not finite"}
    np.testing.assert_array_equal(table.returns, 0.0)
    np.testing.assert_array_equal(table.violation, 1.0)
    np.testing.assert_array_equal(table.cost, 2 * LENGTH)


def test_the_policy_sees_the_costs_of_its_world_s_step_before_and_none_at_an_episode_s_start():
    class Watching(Push):
        def act(self, observation, deterministic=True, costs=None):
            assert costs is not None
            # The cost of the step before is that of the place it led to, and an episode starts where nothing costs.
            seen.append(costs[:, 0] - np.maximum(observation[:, 0] - 1.0, 0.0))
            return super().act(observation, deterministic, costs)

    seen: list[np.ndarray] = []
    env = ToyEnvironment(num_worlds=2, diverge={(1, 0, 15)})
    evaluate(Watching(1.0), env, 4)
    np.testing.assert_allclose(seen, 0.0, atol=1e-12)
    assert len(seen) == 2 * LENGTH


def test_a_table_survives_json_to_the_bit():
    table = evaluate(Push(0.3), ToyEnvironment(diverge={(2, 1, 3)}), 9)
    again = EpisodeTable.from_json(json.loads(json.dumps(table.to_json())))
    for name in ("returns", "costs", "violation", "goals", "length", "failed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))
    assert again.failures == table.failures
    assert again.cost_names == table.cost_names


def test_a_damaged_table_is_refused():
    data = evaluate(Push(0.3), ToyEnvironment(), 2).to_json()
    for name in data:
        with pytest.raises(RunError, match="episode table"):
            EpisodeTable.from_json({key: value for key, value in data.items() if key != name})


def test_random_actions_are_equal_on_every_backend():
    a = evaluate(RandomPolicy(1, seed=3), ToyEnvironment("exact"), 5)
    b = evaluate(RandomPolicy(1, seed=3), ToyEnvironment("twin"), 5)
    assert a.to_json() == b.to_json()


def test_no_episodes_is_an_error():
    with pytest.raises(ValueError, match="at least 1"):
        evaluate(Push(0.0), ToyEnvironment(), 0)
