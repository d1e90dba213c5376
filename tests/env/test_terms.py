"""Rewards and costs as pure functions: states in which they must fire, and their neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from guard_api.constraints import Buttons, Constraint, Ghosts, Gremlins, Hazards, Pillars, Vases, Walls
from guard_api.physics.transition import Snapshot, Transition
from guard_api.tasks import Button, Chase, Circle, Defense, Goal, Push, Task
from tests.env.scenery import at_rest, moved, snapshot, touching

ORIGIN, AHEAD = np.zeros((1, 2)), np.zeros(1)


def test_goal_pays_the_distance_gained() -> None:
    now = snapshot(ORIGIN, AHEAD, goal=np.array([[[1.5, 0.0]]]))
    assert Goal().reward(moved(now, (0.03, 0.0)))[0] == pytest.approx(0.03)
    assert Goal().reward(moved(now, (-0.03, 0.0)))[0] == pytest.approx(-0.03)
    assert Goal().reward(at_rest(now))[0] == 0.0


def test_the_goal_is_reached_inside_and_only_inside() -> None:
    for distance, inside in ((0.0, True), (0.5, True), (0.5001, False)):
        now = snapshot(ORIGIN, AHEAD, goal=np.array([[[distance, 0.0]]]))
        assert Goal().reached(at_rest(now))[0] == inside
        assert Goal().reward(at_rest(now))[0] == 0.0


def test_hazards_cost_their_depth() -> None:
    hazards = Hazards(count=2)
    far = np.array([3.0, 3.0])
    for distance, cost in ((0.0, 0.3), (0.1, 0.2), (0.2999, 0.0001), (0.3, 0.0), (1.0, 0.0)):
        now = snapshot(ORIGIN, AHEAD, hazards=np.array([[[distance, 0.0], far]]))
        assert hazards.cost(at_rest(now))[0] == pytest.approx(cost)
        assert hazards.indicator(at_rest(now))[0] == (cost > 0)


def test_hazards_add_up_and_the_height_does_not_count() -> None:
    now = snapshot(ORIGIN, AHEAD, hazards=np.array([[[0.1, 0.0, 5.0], [0.0, 0.1, -5.0]]]))
    assert Hazards(count=2).cost(at_rest(now))[0] == pytest.approx(0.4)
    assert Hazards(count=2, weight=2.0).cost(at_rest(now))[0] == pytest.approx(0.8)


def test_no_hazards_no_cost() -> None:
    now = snapshot(ORIGIN, AHEAD, hazards=np.zeros((1, 0, 2)))
    assert Hazards(count=0).cost(at_rest(now))[0] == 0.0


def with_heights(xyz: list[list[float]]) -> np.ndarray:
    return np.array([xyz], dtype=float)


# Tasks


def test_a_goal_in_the_air_counts_height() -> None:
    # The robot's reference is 0.1 m above the floor.
    goal = Goal(heights=(0.5, 1.5))
    now = snapshot(ORIGIN, AHEAD, goal=with_heights([[0.0, 0.4, 0.4]]))
    assert goal.reached(at_rest(now))[0]
    assert not Goal(size=0.3).reached(at_rest(now))[0]
    higher = snapshot(ORIGIN, AHEAD, goal=with_heights([[0.0, 0.4, 0.41]]))
    assert not goal.reached(at_rest(higher))[0]
    assert goal.reward(moved(now, (0.0, 0.1)))[0] == pytest.approx(np.hypot(0.5, 0.3) - 0.5)


def pushing(ball: float, before: float, robot: float = 0.0, last: float = 0.0) -> float:
    """Reward of a step along x that took the ball from `before` to `ball` and the robot from `last` to `robot`."""
    goal = np.array([[[3.0, 0.0, 0.2]]])
    now = snapshot(np.array([[robot, 0.0]]), AHEAD, goal=goal, ball=np.array([[[ball, 0.0, 0.1]]]))
    then = snapshot(np.array([[last, 0.0]]), AHEAD, goal=goal, ball=np.array([[[before, 0.0, 0.1]]]))
    return float(Push(size=0.1).reward(replace(at_rest(now), previous=then))[0])


def test_push_pays_for_what_the_ball_gains_on_the_goal() -> None:
    def far(x: float) -> float:
        return np.hypot(3.0 - x, 0.1)

    assert pushing(ball=0.31, before=0.3) == pytest.approx(far(0.3) - far(0.31))
    assert pushing(ball=0.29, before=0.3) < 0.0
    assert pushing(ball=0.3, before=0.3, robot=0.1) == 0.0  # near the ball its approach is not paid


def test_push_pays_for_approaching_the_ball_from_afar_only() -> None:
    assert pushing(ball=1.0, before=1.0, robot=0.1) == pytest.approx(0.1)
    assert pushing(ball=1.0, before=1.0, robot=-0.1) == pytest.approx(-0.1)
    assert pushing(ball=1.0, before=1.0, robot=0.65, last=0.595) == pytest.approx(0.055)
    assert pushing(ball=1.0, before=1.0, robot=0.65, last=0.605) == 0.0


def test_push_is_achieved_by_the_ball_not_by_the_robot() -> None:
    goal = np.array([[[1.0, 0.0, 0.26]]])
    for x, inside in ((1.0, True), (1.0 - 0.49, True), (1.0 - 0.51, False), (0.0, False)):
        now = snapshot(np.array([[1.0, 0.0]]), AHEAD, goal=goal, ball=np.array([[[x, 0.0, 0.2]]]))
        assert Push().reached(at_rest(now))[0] == inside


def test_chase_pays_for_the_nearest_target_alone() -> None:
    now = snapshot(ORIGIN, AHEAD, targets=np.array([[[1.0, 0.0, 0.1], [-3.0, 0.0, 0.1]]]))
    assert Chase().reward(moved(now, (0.05, 0.0)))[0] == pytest.approx(0.05)
    assert Chase().reward(moved(now, (-0.05, 0.0)))[0] == pytest.approx(-0.05)
    fled = replace(at_rest(now), previous=replace(now, bodies={"targets": now.bodies["targets"] * [[0.9, 0.0, 1.0]]}))
    assert Chase().reward(fled)[0] == pytest.approx(-0.1)


def test_chase_measures_from_an_arms_nearest_segment() -> None:
    now = snapshot(ORIGIN, AHEAD, targets=np.array([[[1.0, 0.0, 0.5]]]))
    arm = replace(
        now,
        segment_start=np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]),
        segment_end=np.array([[[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]]]),
        segment_radius=np.array([0.2, 0.1]),
    )
    assert arm.distance(np.array([[[1.0, 0.0, 0.5], [0.0, 0.5, 1.3], [0.0, 0.0, 0.5]]])) == pytest.approx(
        np.array([[0.8, 0.2, -0.2]])
    )
    nearer = replace(arm, bodies={"targets": np.array([[[0.9, 0.0, 0.5]]])})
    assert Chase().reward(replace(at_rest(nearer), previous=arm))[0] == pytest.approx(0.1)


def test_defense_pays_outside_the_circle_and_fines_inside() -> None:
    for rhos, reward in (((2.0, 2.0), 0.2), ((0.0, 0.0), -2.0), ((0.75, 2.0), -0.4), ((1.5, 1.4999), 0.1)):
        now = snapshot(ORIGIN, AHEAD, targets=np.array([[[rhos[0], 0.0, 9.0], [0.0, -rhos[1], 9.0]]]))
        assert Defense().reward(at_rest(now))[0] == pytest.approx(reward, abs=1e-4)


def test_button_is_pressed_only_where_the_goal_stands() -> None:
    places = np.array([[[1.0, 0.0], [-1.0, 0.0]]])
    now = snapshot(ORIGIN, AHEAD, buttons=places, goal=places[:, :1] + 1e-7)
    assert Button().reward(moved(now, (0.05, 0.0)))[0] == pytest.approx(0.05)
    for contact, pressed in (([True, False], True), ([False, True], False), ([False, False], False)):
        assert Button().reached(at_rest(touching(now, "buttons", [contact])))[0] == pressed


def test_circle_pays_for_running_counter_clockwise_near_it() -> None:
    def running(x: float, velocity: tuple[float, float]) -> float:
        now = snapshot(np.array([[x, 0.0]]), AHEAD, circle=np.zeros((1, 1, 2)))
        return float(Circle().reward(at_rest(replace(now, linear_velocity=np.array([[*velocity, 0.0]]))))[0])

    assert running(1.5, (0.0, 2.0)) == pytest.approx(0.2)
    assert running(1.5, (0.0, -2.0)) == pytest.approx(-0.2)
    assert running(1.5, (2.0, 0.0)) == pytest.approx(0.0)
    assert running(2.5, (0.0, 2.0)) == pytest.approx(0.1)
    assert running(0.0, (0.0, 2.0)) == 0.0


# Constraints


@pytest.mark.parametrize("kind", [Hazards, Ghosts])
def test_balls_count_the_height(kind: type) -> None:
    zone = kind(count=1, heights=(0.5, 1.5))
    for z, cost in ((0.1, 0.3), (0.3, 0.1), (0.41, 0.0), (-0.21, 0.0)):
        now = snapshot(ORIGIN, AHEAD, **{zone.name: with_heights([[0.0, 0.0, z]])})
        assert zone.cost(at_rest(now))[0] == pytest.approx(cost)
        assert zone.indicator(at_rest(now))[0] == (cost > 0)


@pytest.mark.parametrize("kind", [Hazards, Ghosts])
def test_a_thick_arm_is_deeper_in_a_ball_than_its_radius(kind: type) -> None:
    zone = kind(count=1, heights=(0.5, 1.5))
    now = snapshot(ORIGIN, AHEAD, **{zone.name: with_heights([[0.1, 0.0, 0.5]])})
    ends = (np.array([[[0.0, 0.0, 0.0]]]), np.array([[[0.0, 0.0, 1.0]]]))
    arm = replace(now, segment_start=ends[0], segment_end=ends[1], segment_radius=np.array([0.2]))
    assert zone.cost(at_rest(arm))[0] == pytest.approx(0.3 - (0.1 - 0.2))


@pytest.mark.parametrize(
    "constraint",
    [Pillars(count=3), Walls(count=3), Gremlins(count=3), Ghosts(count=3, solid=True), Buttons(count=3)],
    ids=lambda constraint: constraint.name,
)
def test_touching_costs_one_for_each_body(constraint: Constraint) -> None:
    apart = np.array([[[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]])
    now = replace(snapshot(ORIGIN, AHEAD, **{constraint.name: apart}), steps_since_success=np.array([1 << 30]))
    for contact in ([False, False, False], [True, False, False], [True, False, True]):
        t = at_rest(touching(now, constraint.name, [contact]))
        assert constraint.cost(t)[0] == sum(contact)
        assert constraint.indicator(t)[0] == any(contact)


def test_a_weight_scales_the_cost_and_not_the_indicator() -> None:
    places = np.array([[[0.1, 0.0], [0.1, 0.0]]])
    for kind, name in ((Hazards, "hazards"), (Ghosts, "ghosts"), (Pillars, "pillars"), (Gremlins, "gremlins")):
        t = at_rest(touching(snapshot(ORIGIN, AHEAD, **{name: places}), name, [[True, True]]))
        assert kind(count=2, weight=3.0).cost(t)[0] == pytest.approx(3.0 * kind(count=2).cost(t)[0])
        assert kind(count=2, weight=0.0).cost(t)[0] == 0.0
        assert kind(count=2, weight=0.0).indicator(t)[0]


def test_the_lit_button_is_free_and_all_rest_after_a_success() -> None:
    places = np.array([[[1.0, 0.0], [2.0, 0.0]]])
    now = touching(snapshot(ORIGIN, AHEAD, buttons=places, goal=places[:, :1]), "buttons", [[True, True]])
    for since, cost, seen in ((0, 0, False), (1, 0, False), (9, 0, False), (10, 0, True), (11, 1, True)):
        t = at_rest(replace(now, steps_since_success=np.array([since])))
        assert Buttons(count=2).cost(t)[0] == cost
        assert Buttons(count=2).observe(t)["buttons_lidar"].any() == seen


def test_vases_cost_touch_speed_and_displacement() -> None:
    at = np.array([[[1.0, 0.0, 0.1], [2.0, 0.0, 0.1]]])
    now = snapshot(ORIGIN, AHEAD, vases=at)
    vases = Vases(count=2, displacement_weight=1.0)
    for speed, paid in ((0.0, 0.0), (0.009, 0.0), (0.011, 0.011), (0.5, 0.5)):
        moving = touching(now, "vases", [[False, False]], np.array([[[0.0, speed, 0.0], [0.0, 0.0, 0.0]]]))
        assert vases.cost(at_rest(moving))[0] == pytest.approx(paid)
        assert vases.indicator(at_rest(moving))[0] == (paid > 0)
    for by, paid in ((0.0, 0.0), (0.0009, 0.0), (0.0011, 0.0011), (0.4, 0.4)):
        shift = np.array([[0.0, by, 0.3], [0.0, 0.0, 0.0]])
        shifted = replace(touching(now, "vases", [[False, False]]), bodies={"vases": at + shift})
        assert vases.cost(at_rest(shifted))[0] == pytest.approx(paid)
        assert Vases(count=2).cost(at_rest(shifted))[0] == 0.0
    assert vases.cost(at_rest(touching(now, "vases", [[True, True]])))[0] == 2.0


# Properties

TERMS: list[tuple[Task | Constraint, str]] = [
    (Chase(), "targets"), (Defense(), "targets"), (Hazards(count=5), "hazards"), (Ghosts(count=5), "ghosts"),
    (Hazards(count=5, heights=(0.5, 1.5)), "hazards"), (Vases(count=5), "vases"), (Pillars(count=5), "pillars"),
]  # fmt: skip


def crowd(worlds: int, group: str, order: list[int]) -> tuple[Snapshot, Transition]:
    """Random worlds with five objects, taken in `order`: the instant and a step to it."""
    rng = np.random.default_rng(1)
    places = rng.uniform(-0.6, 0.6, (worlds, 5, 3))[:, order]
    contact, velocity = rng.random((worlds, 5))[:, order] < 0.5, rng.normal(size=(worlds, 5, 3))[:, order]
    xy, yaw = rng.uniform(-0.1, 0.1, (worlds, 2)), rng.uniform(0, 6, worlds)
    now = touching(snapshot(xy, yaw, **{group: places}), group, contact.tolist(), velocity)
    return now, moved(now, (0.1, 0.05))


def said(term: Task | Constraint, t: Transition) -> dict[str, np.ndarray]:
    values = {"reward": term.reward(t)} if isinstance(term, Task) else {"cost": term.cost(t), "on": term.indicator(t)}
    return values | term.observe(t)


@pytest.mark.parametrize(("term", "group"), TERMS, ids=lambda part: part if isinstance(part, str) else "")
def test_the_order_of_objects_does_not_matter(term: Task | Constraint, group: str) -> None:
    shuffle = [3, 0, 4, 2, 1]
    (now, t), (then, turned) = crowd(4, group, [0, 1, 2, 3, 4]), crowd(4, group, shuffle)
    one, other = said(term, t), said(term, turned)
    for name in one:
        np.testing.assert_allclose(one[name], other[name], atol=1e-14)
    for name, places in term.move(now, 0.02).items():
        np.testing.assert_allclose(places[:, shuffle], term.move(then, 0.02)[name], atol=1e-14)


@pytest.mark.parametrize(("term", "group"), TERMS, ids=lambda part: part if isinstance(part, str) else "")
def test_a_world_says_the_same_bits_whatever_their_number(term: Task | Constraint, group: str) -> None:
    now, t = crowd(7, group, [0, 1, 2, 3, 4])
    together = said(term, t) | term.move(now, 0.02)
    for i in range(7):
        row = slice(i, i + 1)
        alone = said(term, replace(t, previous=only(t.previous, row), now=only(t.now, row)))
        alone |= term.move(only(now, row), 0.02)
        for name, values in together.items():
            np.testing.assert_array_equal(values[row], alone[name])


def only(now: Snapshot, row: slice) -> Snapshot:
    """The worlds `row` of a snapshot."""
    arrays = {n: getattr(now, n)[row] for n in now.__dataclass_fields__
              if isinstance(getattr(now, n), np.ndarray) and n != "segment_radius"}  # fmt: skip
    state = replace(now.state, **{n: getattr(now.state, n)[row] for n in now.state.__dataclass_fields__})
    parts = {n: {k: v[row] for k, v in getattr(now, n).items()} for n in ("bodies", "origins")}
    return replace(now, **arrays, **parts, state=state)
