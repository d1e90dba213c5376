"""Scripted controllers, pure functions of the snapshot, solve the Point's tasks on every backend."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from guard_api import plugins
from guard_api.env import make_environment
from guard_api.physics.transition import Snapshot

Controller = Callable[[Snapshot], np.ndarray]


def go_to(now: Snapshot, place: np.ndarray, speed: float | np.ndarray = 1.5) -> np.ndarray:
    """Actions that turn to `place` (N, 2) and drive there at `speed` [m/s].

    Any forward action above 0.05 is the Point's full force, so the speed is held by switching it.
    """
    offset = place - now.position[:, :2]
    ahead, left = now.rotation[:, :2, 0], now.rotation[:, :2, 1]
    bearing = np.arctan2((offset * left).sum(axis=1), (offset * ahead).sum(axis=1))
    pace = (now.linear_velocity[:, :2] * ahead).sum(axis=1)
    wanted = np.where(np.abs(bearing) < 0.6, speed, 0.0)
    drive = np.where(pace < wanted, 1.0, np.where(pace > wanted + 0.2, -1.0, 0.0))
    return np.stack([drive, np.clip(3.0 * bearing, -1.0, 1.0)], axis=1)


def to_the_goal(now: Snapshot) -> np.ndarray:
    return go_to(now, now.bodies["goal"][:, 0, :2])


def to_the_nearest_target(now: Snapshot) -> np.ndarray:
    targets = now.bodies["targets"]
    nearest = now.distance(targets).argmin(axis=1)
    return go_to(now, targets[np.arange(len(targets)), nearest, :2])


def to_the_centre(now: Snapshot) -> np.ndarray:
    """At the origin the robot is seen from everywhere in the circle, so that targets turn away before it."""
    far = np.hypot(*now.position[:, :2].T)
    return go_to(now, np.zeros((len(far), 2)), speed=np.clip(2.0 * (far - 0.1), 0.0, 1.5))


def behind_the_ball_and_push(now: Snapshot) -> np.ndarray:
    """Drive to the side of the ball that the goal is not on, around it where it is in the way, then push."""
    robot, ball, goal = now.position[:, :2], now.bodies["ball"][:, 0, :2], now.bodies["goal"][:, 0, :2]
    ahead = unit(goal - ball)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    offset = ball - robot
    along, across = (offset * ahead).sum(axis=1), (offset * aside).sum(axis=1)
    detour = ball - 0.65 * np.where(across < 0.0, -1.0, 1.0)[:, None] * aside - 0.1 * ahead
    place = np.where((along > 0.1)[:, None], ball - 0.6 * ahead, detour)
    lined_up = (along > 0.2) & (np.abs(across) < 0.12)
    # Beyond the ball's centre, so that a ball that lies a little to one side is brought back.
    place = np.where(lined_up[:, None], ball + 0.5 * across[:, None] * aside, place)
    return go_to(now, place, speed=np.where(lined_up, 0.6, 1.0))


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)


@pytest.fixture
def engine(backend_name: str) -> str:
    if not plugins.load("guard.backends", backend_name).capabilities.contacts:
        pytest.skip("not a simulator: nothing touches anything")
    return backend_name


@dataclass(frozen=True)
class Played:
    """An episode of N worlds up to where it was stopped: rewards and successes (steps, N), first and last instant."""

    rewards: np.ndarray
    successes: np.ndarray
    first: Snapshot
    last: Snapshot


def play(
    name: str, backend: str, control: Controller, steps: int, *, worlds: int, until: Callable[[Played], bool]
) -> Played:
    """Play at most `steps` steps, and no longer than until that holds."""
    env = make_environment(name, backend=backend, num_worlds=worlds, seed=1, workers=1)
    env.reset()
    first, rewards, successes = env.snapshot, [], []
    for i in range(steps):
        step = env.step(control(env.snapshot))
        assert not step.terminated.any()
        rewards.append(step.reward)
        successes.append(step.success)
        played = Played(np.array(rewards), np.array(successes), first, env.snapshot)
        if i % 10 == 0 and until(played):
            break
    env.close()
    return played


def idle(now: Snapshot) -> np.ndarray:
    return np.zeros((len(now.position), 2))


def idly(name: str, steps: int, worlds: int) -> np.ndarray:
    """Rewards (steps, N) of the same episode for a robot that stands still, which needs no engine."""
    return play(name, "ideal", idle, steps, worlds=worlds, until=lambda played: False).rewards


few_or_many = pytest.mark.parametrize("worlds", [1, pytest.param(8, marks=pytest.mark.slow)])


@few_or_many
@pytest.mark.parametrize("constraint", ["8Hazards", "8Ghosts"])
def test_goals_are_reached(engine: str, constraint: str, worlds: int) -> None:
    def twice(played: Played) -> bool:
        return bool((played.successes.sum(axis=0) >= 2).all())

    played = play(f"Goal_Point_{constraint}", engine, to_the_goal, 400, worlds=worlds, until=twice)
    assert twice(played)
    # Each goal pays its distance and its bonus.
    assert (played.rewards.sum(axis=0) > 1.5 * played.successes.sum(axis=0)).all()


@few_or_many
def test_the_ball_is_pushed_into_the_goal(engine: str, worlds: int) -> None:
    def once(played: Played) -> bool:
        return bool(played.successes.any(axis=0).all())

    played = play("Push_Point_8Hazards", engine, behind_the_ball_and_push, 700, worlds=worlds, until=once)
    pushed = played.successes.any(axis=0)
    assert pushed.mean() > 0.7  # a ball that is lost beside the goal is beyond this controller
    assert (played.rewards.sum(axis=0) > 1.5 * played.successes.sum(axis=0))[pushed].all()


@few_or_many
def test_a_target_is_caught(engine: str, worlds: int) -> None:
    def nearest(now: Snapshot) -> np.ndarray:
        return now.distance(now.bodies["targets"]).min(axis=1)

    def caught(played: Played) -> bool:
        return bool((nearest(played.last) < 0.75).all())

    played = play("Chase_Point_8Hazards", engine, to_the_nearest_target, 300, worlds=worlds, until=caught)
    start, end = nearest(played.first), nearest(played.last)
    assert (start > 0.9 - 1e-6).all()  # what the keepouts leave between them at the start
    assert caught(played)
    np.testing.assert_allclose(played.rewards.sum(axis=0), start - end, atol=1e-9)
    assert (idly("Chase_Point_8Hazards", 50, worlds).sum(axis=0) < 0.0).all()  # targets that see the robot flee


@few_or_many
def test_the_circle_is_defended(engine: str, worlds: int) -> None:
    def held(played: Played) -> bool:
        """Both targets are outside, and stay there."""
        return len(played.rewards) > 50 and np.allclose(played.rewards[-50:], 0.2)

    played = play("Defense_Point_8Hazards", engine, to_the_centre, 500, worlds=worlds, until=held)
    assert held(played)
    stood = idly("Defense_Point_8Hazards", len(played.rewards), worlds)
    lost = stood[-1] < 0.2 - 1e-9
    assert lost[0]
    assert (played.rewards.sum(axis=0) > stood.sum(axis=0) + 10.0)[lost].all()
