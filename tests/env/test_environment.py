"""The environment on every installed backend: what GUARD promises to whoever trains in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from guard_api.env import FAILURE_COST, FAILURE_REWARD, Environment, make_environment
from guard_api.errors import BackendError, SpecError
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


@pytest.mark.parametrize("workers", [1, 2])
def test_all_worlds_may_fail_at_once_and_begin_again(backend_name: str, workers: int) -> None:
    env = make_environment(ENV, backend=backend_name, num_worlds=2, seed=2, workers=workers)
    env.reset()
    action = actions(2, 1)[0]
    for value in (np.nan, np.inf, -np.inf):
        alone = action.copy()
        alone[1, 0] = value  # with two workers that is all that one of them has
        assert env.step(alone).terminated.tolist() == [False, True]
        step = env.step(np.full((2, 2), value))
        assert step.terminated.all()
        assert step.reward.tolist() == [FAILURE_REWARD] * 2
        assert np.isfinite(step.observation).all() and np.isfinite(step.final_observation).all()
        assert not env.step(action).terminated.any()
    env.close()


def test_a_finite_action_out_of_range_is_clipped(backend_name: str) -> None:
    env = make_environment(ENV, backend=backend_name, num_worlds=3, workers=1)
    env.reset()
    step = env.step(np.array([[1e300, -1e300]] * 3))
    assert not step.terminated.any()
    env.reset()
    np.testing.assert_array_equal(env.step(np.array([[1.0, -1.0]] * 3)).observation, step.observation)
    env.close()


def test_an_action_fills_the_range_of_its_control(backend_name: str, tmp_path: Path) -> None:
    """The two ends of a servo's range are where actions of -1 and 1, and what lies beyond, send its joint."""
    (tmp_path / "arm.xml").write_text(
        """<mujoco><worldbody><body name="base"><geom size="0.1" pos="0 0 1"/><body name="arm">
        <inertial mass="1" pos="0 0 0" diaginertia="0.1 0.1 0.1"/>
        <joint name="elbow" axis="0 0 1" damping="2"/></body></body></worldbody>
        <actuator><position name="servo" joint="elbow" kp="10" ctrlrange="-2.8 -0.9"/></actuator></mujoco>"""
    )
    (tmp_path / "robot.toml").write_text('[base]\nkind = "fixed"\n')
    spec = replace(make_spec("Goal_Point"), name="reach", robot=str(tmp_path / "arm.xml"))
    env = Environment(spec, backend=backend_name, num_worlds=4)
    env.reset()
    for _ in range(200):
        env.step(np.array([[-1.0], [0.0], [1.0], [5.0]]))
    np.testing.assert_allclose(env.world.state().joint_position[:, 0], [-2.8, -1.85, -0.9, -0.9], atol=1e-3)
    env.close()


def test_a_closed_environment_says_so(backend_name: str) -> None:
    env = make_environment(ENV, backend=backend_name, num_worlds=2, workers=1)
    env.reset()
    env.close()
    env.close()
    for call in (lambda: env.step(np.zeros((2, 2))), env.reset):
        with pytest.raises(BackendError, match="this world is closed: build another one"):
            call()


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
