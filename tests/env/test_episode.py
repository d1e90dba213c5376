"""Starts and respawns: what placements ask of the robot as it stands, things on others, streams of worlds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guard_api.constraints import Buttons, Gremlins, Hazards
from guard_api.env import Environment, make_environment
from guard_api.model.library import load_robot
from guard_api.scene.episode import EpisodeStarter
from guard_api.scene.spec import BodyGroup, BodySpec, Placement, SceneSpec
from guard_api.scene.stance import HomeStance
from guard_api.shapes import Sphere
from guard_api.spec import EnvSpec
from guard_api.suite import make_spec
from guard_api.tasks import Button, Goal

EXTENTS = (-2.0, -2.0, 2.0, 2.0)


def starter(spec: EnvSpec | str, num_worlds: int) -> EpisodeStarter:
    spec = make_spec(spec) if isinstance(spec, str) else spec
    robot = load_robot(spec.robot)
    scene = SceneSpec(robot=robot, groups=tuple(g for g in spec.groups if g.body.physics != "phantom"))
    return EpisodeStarter(scene, spec.groups, spec.extents, num_worlds, spec.robot_placement)


def begin(spec: EnvSpec | str, num_worlds: int, seed: int = 0, episode: int = 0):
    everywhere = np.ones(num_worlds, dtype=bool)
    return starter(spec, num_worlds).begin(everywhere, np.full(num_worlds, episode), seed)


def ball(name: str, count: int, placement: Placement, keepout: float = 0.1) -> BodyGroup:
    body = BodySpec(shape=Sphere(radius=0.1), physics="phantom", height=0.2, keepout=keepout)
    return BodyGroup(name=name, body=body, count=count, placement=placement)


@given(
    robot=st.sampled_from(["arm3", "arm6", "drone", "point", "ant"]),
    clearance=st.floats(0.0, 0.6),
    apart=st.floats(0.0, 1.0),
    seed=st.integers(0, 2**31),
)
def test_clearance_and_apart_hold_for_the_robot_at_home(robot: str, clearance: float, apart: float, seed: int) -> None:
    model = load_robot(robot)
    scene = SceneSpec(robot=model)
    placement = Placement(heights=(0.0, 2.0), clearance=clearance, apart=apart)
    groups = [ball("balls", 3, placement)]
    everywhere = np.ones(5, dtype=bool)
    start, positions = EpisodeStarter(scene, groups, EXTENTS, 5).begin(everywhere, np.zeros(5, np.int64), seed)
    if model.base == "planar":
        place, yaw = start.joint_position[:, :2], start.joint_position[:, 2]
    else:
        w, z = start.base_quaternion[:, 0], start.base_quaternion[:, 3]
        place, yaw = start.base_position[:, :2], 2 * np.arctan2(z, w)
    standing = HomeStance(scene)(place, yaw)
    if clearance > 0.0:  # 0 asks for nothing
        assert (standing.distance(positions["balls"]) >= clearance - 1e-9).all()
    assert (np.linalg.norm(positions["balls"] - standing.position[:, None], axis=-1) >= apart - 1e-9).all()


@pytest.mark.parametrize("name", ["Goal_Arm3_8Hazards", "Goal_Drone_8Hazards", "Goal_Ant_8Hazards"])
def test_home_stance_is_where_the_simulator_puts_the_robot(name: str) -> None:
    env = make_environment(name, backend="ideal", num_worlds=4, seed=2)
    start, _ = begin(name, 4, seed=2)
    place = start.base_position[:, :2]
    yaw = 2 * np.arctan2(start.base_quaternion[:, 3], start.base_quaternion[:, 0])
    standing = HomeStance(env.scene)(place, yaw)
    for field in ("position", "rotation", "segment_start", "segment_end"):
        np.testing.assert_allclose(getattr(standing, field), getattr(env.snapshot, field), atol=1e-9)
    env.close()


@pytest.mark.parametrize(
    "name", ["Goal_Arm3_8Hazards", "Goal_Arm6_8Ghosts", "Goal_Drone_8Ghosts", "Chase_Point_8Ghosts"]
)
def test_no_episode_starts_with_a_cost_or_in_the_goal(name: str) -> None:
    env = make_environment(name, backend="ideal", num_worlds=64)
    transition = env._standstill(env.snapshot)
    assert (env._costs(transition) == 0.0).all()
    assert not env.spec.task.reached(transition).any()
    env.close()


def test_worlds_do_not_depend_on_their_number_nor_on_earlier_episodes() -> None:
    for name in ("Defense_Point_8Ghosts", "Goal_Arm3_8Hazards", "Button_Point_4Buttons"):
        _, many = begin(name, 9, seed=3, episode=5)
        _, few = begin(name, 2, seed=3, episode=5)
        some = starter(name, 9)
        some.begin(np.ones(9, dtype=bool), np.zeros(9, np.int64), 3)
        only = np.arange(9) == 1
        _, later = some.begin(only, np.full(9, 5), 3)
        for group, positions in many.items():
            np.testing.assert_array_equal(positions[:2], few[group])
            np.testing.assert_array_equal(positions[1], later[group][1])


def test_robot_starts_where_it_may() -> None:
    place = Placement(rectangles=((-3.0, -3.0, -2.0, -2.0),))
    spec = replace(make_spec("Goal_Point_2Hazards"), robot_placement=place)
    start, _ = begin(spec, 50)
    x = start.joint_position[:, :2]
    assert ((x >= -2.6 - 1e-9) & (x <= -2.4 + 1e-9)).all()
    arm, _ = begin("Goal_Arm3_8Hazards", 5)
    assert (arm.base_position[:, :2] == 0.0).all()
    assert len(np.unique(arm.base_quaternion[:, 0])) == 5


def test_first_walls_stand_at_their_locations() -> None:
    at = ((1.0, 0.0), (1.0, 1.0))
    spec = replace(make_spec("Goal_Point_8Hazards"), constraints=(walls(3, at),))
    start, positions = begin(spec, 20)
    np.testing.assert_array_equal(positions["walls"][:, :2, :2], np.broadcast_to(at, (20, 2, 2)))
    np.testing.assert_array_equal(start.body_position, positions["walls"])
    third = positions["walls"][:, 2, :2]
    assert np.linalg.norm(third[:, None] - at, axis=-1).min() >= 1.4 - 1e-9


def walls(count: int, locations: tuple):
    from guard_api.constraints import Walls

    return Walls(count=count, locations=locations)


def respawned(env: Environment, mask: np.ndarray, **moved: np.ndarray) -> np.ndarray:
    """New places of the goal in the masked worlds, after other bodies were moved."""
    now = replace(env.snapshot, bodies={**env.snapshot.bodies, **moved})
    places, stuck = env._starter.respawn("goal", mask, now)
    assert not stuck.any()
    return places[:, 0]


def test_a_goal_respawns_clear_of_where_movers_are_now() -> None:
    """Solid and walked-through ones alike: all are moved to the left half, where no goal may appear then."""
    task, movers = Goal(), (Gremlins(count=2), Hazards(count=4))
    spec = EnvSpec(name="test", robot="point", task=task, constraints=movers)
    env = Environment(spec, backend="ideal", num_worlds=200, seed=1)
    left = np.array([[-1.5, -1.5, 0.1], [-1.5, 1.5, 0.1]])
    gremlins = np.broadcast_to(left, (200, 2, 3))
    hazards = np.broadcast_to([[-1.5, -0.5, 0.0], [-1.5, 0.5, 0.0], [-0.5, -1.0, 0.0], [-0.5, 1.0, 0.0]], (200, 4, 3))
    everywhere = np.ones(200, dtype=bool)
    goal = respawned(env, everywhere, gremlins=gremlins, hazards=hazards)[:, None, :2]
    assert np.linalg.norm(goal - gremlins[..., :2], axis=-1).min() >= 0.9
    assert np.linalg.norm(goal - hazards[..., :2], axis=-1).min() >= 0.8
    assert np.linalg.norm(goal - env.snapshot.position[:, None, :2], axis=-1).min() >= 0.8
    before = env.snapshot.bodies["hazards"][..., :2]
    assert np.linalg.norm(goal - before, axis=-1).min() < 0.3  # where they were at the start counts no more
    env.close()


def test_a_respawned_ball_gets_a_new_height_clear_of_the_arm_as_it_stands() -> None:
    env = make_environment("Goal_Arm3_8Hazards", backend="ideal", num_worlds=100)
    stretched = replace(env.snapshot, position=np.tile([0.6, 0.6, 1.0], (100, 1)))
    mask = np.arange(100) % 2 == 0
    places, stuck = env._starter.respawn("goal", mask, stretched)
    assert not stuck.any()
    np.testing.assert_array_equal(places[~mask], env.snapshot.bodies["goal"][~mask])
    new = places[mask, 0]
    assert (np.linalg.norm(new - [0.6, 0.6, 1.0], axis=-1) >= 0.5).all()
    assert (np.linalg.norm(new, axis=-1) <= 2.0).all()
    assert ((new[:, 2] >= 0.5) & (new[:, 2] <= 1.5)).all()
    assert (new[:, 2] != env.snapshot.bodies["goal"][mask, 0, 2]).all()
    assert (np.linalg.norm(new[:, :2], axis=-1) >= 0.8).all()  # the base is kept clear, not the column of the tip
    env.close()


def test_a_world_without_a_place_says_so_and_keeps_the_old_one() -> None:
    env = make_environment("Goal_Point_8Hazards", backend="ideal", num_worlds=2)
    grid = np.stack(np.meshgrid([-1.5, 0.0, 1.5], [-1.5, 0.0, 1.5]), axis=-1).reshape(-1, 2)[:8]
    crowded = np.zeros((2, 8, 3))
    crowded[0, :, :2] = grid
    crowded[0, :, :2] *= 0.7
    crowded[1] = env.snapshot.bodies["hazards"][1]
    position = np.tile([1.05, 1.05, 0.1], (2, 1))
    now = replace(env.snapshot, bodies={**env.snapshot.bodies, "hazards": crowded}, position=position)
    places, stuck = env._starter.respawn("goal", np.ones(2, dtype=bool), now)
    assert stuck[0]
    np.testing.assert_array_equal(places[0], env.snapshot.bodies["goal"][0])
    env.close()


def test_goals_stand_on_buttons_and_move_to_another_one() -> None:
    spec = EnvSpec(name="test", robot="point", task=Button(), constraints=(Buttons(count=3),))
    env = Environment(spec, backend="ideal", num_worlds=300)
    lit = on_button(env.snapshot.bodies["goal"][:, 0], env.snapshot.bodies["buttons"])
    assert (lit.sum(axis=1) == 1).all()
    np.testing.assert_allclose(lit.mean(axis=0), 1 / 3, atol=0.1)
    assert (env.snapshot.bodies["goal"][:, 0, 2] == 0.1).all()
    again = on_button(respawned(env, np.ones(300, dtype=bool)), env.snapshot.bodies["buttons"])
    assert (again.sum(axis=1) == 1).all()
    assert not (lit & again).any()
    env.close()


def test_a_single_button_is_lit_again() -> None:
    spec = EnvSpec(name="test", robot="point", task=Button(), constraints=(Buttons(count=1),))
    env = Environment(spec, backend="ideal", num_worlds=3)
    goal = respawned(env, np.ones(3, dtype=bool))
    np.testing.assert_array_equal(goal[:, :2], env.snapshot.bodies["buttons"][:, 0, :2])
    env.close()


def on_button(goal: np.ndarray, buttons: np.ndarray) -> np.ndarray:
    return (goal[:, None, :2] == buttons[..., :2]).all(axis=-1)
