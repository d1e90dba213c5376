"""Movers: GUARD's displacement per environment step for every robot, and the rules that decide their direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guard_api.constraints import Constraint, Ghosts, Gremlins
from guard_api.model.library import load_robot
from guard_api.physics.transition import Snapshot
from guard_api.scene.motion import advanced, away_from_neighbours
from guard_api.suite import SUITE_ROBOTS, make_spec
from guard_api.tasks import Chase, Defense, Task
from guard_api.tasks.targets import Targets
from tests.env.scenery import snapshot

STRIDE = 0.001
"""How far GUARD's ghosts, and targets that do not flee, go in one environment step [m]."""

ORIGIN = np.zeros((1, 2))


def one(places: list[list[float]]) -> np.ndarray:
    return np.array([places], dtype=float)


def step(
    term: Task | Constraint, group: str, places: list[list[float]], robot: np.ndarray = ORIGIN, duration: float = 0.02
) -> np.ndarray:
    """Displacements (count, 3) of the bodies of `group` in one step of `duration` [s]."""
    now = snapshot(robot, np.zeros(1), **{group: one(places)})
    return (term.move(now, duration)[group] - now.bodies[group])[0]


@pytest.mark.parametrize("robot", SUITE_ROBOTS)
def test_speeds_are_guards_for_every_robot(robot: str) -> None:
    """0.0010 m per environment step towards the robot or home, 0.0100 m in flight, whatever the robot's timestep."""
    model = load_robot(robot)
    duration = model.timestep * model.substeps
    ghosts = make_spec(f"Goal_{robot}_8Ghosts").constraints[0]
    away = step(ghosts, "ghosts", [[2.2, 0.0, 1.0]], duration=duration)[0]
    assert np.linalg.norm(away) == pytest.approx(STRIDE)
    assert away[0] < 0.0
    for task, far in (("Chase", [0.0, 0.0, 0.0]), ("Defense", [-STRIDE, 0.0, 0.0])):
        targets = make_spec(f"{task}_{robot}_8Hazards").task
        flight = step(targets, "targets", [[1.0, 0.0, 1.0]], duration=duration)[0]
        assert np.linalg.norm(flight) == pytest.approx(10 * STRIDE)
        assert flight[0] > 0.0
        # 3.5 m from the robot, and within 2 m of the origin, no target sees it.
        idle = step(targets, "targets", [[1.9, 0.0, 0.6]], np.array([[-1.6, 0.0]]), duration)[0]
        np.testing.assert_allclose(idle, far, atol=1e-12)


def test_ghosts_stop_at_a_respectful_distance() -> None:
    ghosts = Ghosts(count=1)
    for x, moves in ((1.6, True), (1.5, True), (1.4999, False), (0.3, False)):
        assert step(ghosts, "ghosts", [[x, 0.0]]).any() == moves
    assert step(Ghosts(count=1, respect=0.0), "ghosts", [[0.3, 0.0]]).any()


def test_ghosts_come_to_rest_around_a_robot_and_apart() -> None:
    now = snapshot(
        np.array([[1.0, 0.0]]), np.zeros(1), ghosts=one([[-1.6, 0.0], [-1.6, 0.4], [1.0, 1.6], [-2.0, -1.5]])
    )
    final = rest(lambda now: Ghosts(count=4, speed=0.5).move(now, 0.02), now, 600).bodies["ghosts"][0]
    distance = np.linalg.norm(final[:, :2] - [1.0, 0.0], axis=1)
    assert distance.min() > 1.5 - 0.02
    gaps = np.linalg.norm(final[:, None] - final, axis=-1) + 9 * np.eye(4)
    assert gaps.min() > 0.6 - 0.02


def rest(move: Callable, now: Snapshot, steps: int) -> Snapshot:
    for _ in range(steps):
        now = replace(now, bodies={**now.bodies, **move(now)})
    return now


def test_strayed_movers_return_in_the_plane_whatever_the_robot_does() -> None:
    for robot in ([2.0, 2.0], [-2.0, 0.0], [2.6, 0.0]):
        ghost = step(Ghosts(count=1, heights=(0.5, 1.5)), "ghosts", [[2.6, 0.0, 1.0]], np.array([robot]))
        np.testing.assert_allclose(ghost, [[-STRIDE, 0.0, 0.0]], atol=1e-12)
        for task in (Chase(), Defense()):
            target = step(task, "targets", [[0.0, -2.1]], np.array([robot]))
            np.testing.assert_allclose(target, [[0.0, STRIDE, 0.0]], atol=1e-12)


def test_targets_flee_from_what_they_see() -> None:
    for x, seen in ((2.9, True), (3.0, True), (3.0001, False)):
        moved = step(Chase(targets=Targets(travel=9.0)), "targets", [[x, 0.0]])
        np.testing.assert_allclose(moved, [[10 * STRIDE * seen, 0.0, 0.0]], atol=1e-12)
    for x, by in ((1.9, 10 * STRIDE), (2.0, 10 * STRIDE), (2.0001, -STRIDE)):
        moved = step(Defense(targets=Targets(travel=9.0, sight=2.0)), "targets", [[x, 0.0]])
        np.testing.assert_allclose(moved, [[by, 0.0, 0.0]], atol=1e-12)


def test_discs_ignore_heights_and_balls_do_not() -> None:
    above = [[0.6, 0.0, 0.9]]  # 0.8 m above the robot's reference, 0.6 m beside it
    np.testing.assert_allclose(step(Chase(), "targets", above), [[10 * STRIDE, 0.0, 0.0]], atol=1e-12)
    balls = Chase(targets=Targets(heights=(0.5, 1.5)))
    np.testing.assert_allclose(step(balls, "targets", above), [[6 * STRIDE, 0.0, 8 * STRIDE]], atol=1e-12)


def test_neighbours_keep_their_distance() -> None:
    moved = step(Ghosts(count=2), "ghosts", [[0.0, 0.1], [0.0, -0.1]])
    np.testing.assert_allclose(moved, [[0.0, STRIDE, 0.0], [0.0, -STRIDE, 0.0]], atol=1e-12)
    assert not step(Ghosts(count=2), "ghosts", [[0.0, 0.301], [0.0, -0.3]]).any()
    assert not step(Ghosts(count=1), "ghosts", [[0.0, 0.1]]).any()


def test_movers_at_one_place_do_not_break() -> None:
    moved = step(Ghosts(count=2, respect=0.0), "ghosts", [[0.0, 0.0, 0.1], [0.0, 0.0, 0.1]])
    np.testing.assert_array_equal(moved, 0.0)


@given(seed=st.integers(0, 2**32 - 1))
def test_heights_stay_in_their_range_and_speeds_have_a_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heights = (0.5, 1.5)
    places = rng.uniform([-3, -3, 0.5], [3, 3, 1.5], (3, 6, 3))
    robot = rng.uniform(-2, 2, (3, 2))
    ghosts, targets = Ghosts(count=6, speed=2.0, heights=heights), Targets(count=6, flight_speed=5.0, heights=heights)
    for term, group, most in ((ghosts, "ghosts", 2.0 * 6), (Chase(targets=targets), "targets", 5.0 + 0.05 * 5)):
        now = snapshot(robot, np.zeros(3), **{group: places})
        for _ in range(20):
            after = replace(now, bodies=term.move(now, 0.1))
            way = np.linalg.norm(after.bodies[group] - now.bodies[group], axis=-1)
            assert way.max() <= 0.1 * most + 1e-9
            assert after.bodies[group][..., 2].min() >= heights[0]
            assert after.bodies[group][..., 2].max() <= heights[1]
            now = after


def test_a_long_step_and_many_short_ones_agree() -> None:
    """Displacements are speed times time: one step of 20 ms and ten of 2 ms end within what a stride turns."""
    now = snapshot(np.array([[0.3, 0.2]]), np.zeros(1), ghosts=one([[2.0, 1.0], [1.8, 1.2], [-1.0, 1.7]]))
    ghosts = Ghosts(count=3)
    long = rest(lambda now: ghosts.move(now, 0.02), now, 100).bodies["ghosts"]
    short = rest(lambda now: ghosts.move(now, 0.002), now, 1000).bodies["ghosts"]
    np.testing.assert_allclose(long, short, atol=2 * STRIDE)


def test_gremlins_turn_in_phase_on_their_circles() -> None:
    gremlins = Gremlins(count=2, travel=0.35, period=2.0)
    now = snapshot(ORIGIN, np.zeros(1), gremlins=one([[1.0, 0.0, 0.1], [-1.0, 0.5, 0.1]]))
    fastest = 0.0
    for i in range(1, 301):
        moved = gremlins.move(now, 0.02)["gremlins"]
        fastest = max(fastest, np.linalg.norm(moved - now.bodies["gremlins"], axis=-1).max() / 0.02)
        state = replace(now.state, time=np.full(1, 0.02 * i))
        now = replace(now, state=state, bodies={"gremlins": moved})
        if i > 100:
            phase = np.pi * 0.02 * i
            circle = now.origins["gremlins"] + 0.35 * np.array([np.sin(phase), np.cos(phase), 0.0])
            np.testing.assert_allclose(moved, circle, atol=1e-12)
    assert fastest <= 2 * np.pi * 0.35 + 1e-9


def test_directions_of_nothing_are_nothing() -> None:
    assert away_from_neighbours(np.zeros((2, 0, 3)), 0.6).shape == (2, 0, 3)
    np.testing.assert_array_equal(away_from_neighbours(np.zeros((1, 3, 3)), 0.6), 0.0)
    np.testing.assert_array_equal(advanced(np.ones((1, 1, 3)), np.ones((1, 1, 3)), 0.5, None), [[[1.5, 1.5, 1.0]]])
