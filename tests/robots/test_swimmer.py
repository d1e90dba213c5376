"""Swimmer: GUARD's numbers, and moving by friction with the floor on every engine."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.model.library import load_robot
from tests.robots.motion import ENGINES, centre_of_mass, diverged, drive, of_geometry, random_controls, readings, sizes

LINKS = ("robot", "mid", "back")


@pytest.fixture(scope="module")
def swimmer():
    return load_robot("swimmer")


def test_robot_is_guards(swimmer):
    links = [swimmer.links[swimmer.link_index(name)] for name in LINKS]
    assert [link.mass for link in links] == pytest.approx([0.222006] * 3, abs=5e-7)
    assert sum(link.mass for link in swimmer.links) == pytest.approx(0.666018, abs=5e-7)
    for link in links:
        np.testing.assert_allclose(link.inertia, of_geometry(link, 1000.0).inertia, rtol=1e-10, atol=1e-12)
        assert {collision.friction for collision in link.collisions} == {0.75}
    joints = {joint.name: joint for joint in swimmer.joints}
    for name in ("base_x", "base_y", "base_yaw", "motor1_rot", "motor2_rot"):
        assert (joints[name].armature, joints[name].damping) == (0.1, 0.0)
    assert joints["motor1_rot"].limits == joints["motor2_rot"].limits == pytest.approx(np.radians([-100.0, 100.0]))
    assert [actuator.gear for actuator in swimmer.actuators] == [20.0, 20.0]
    assert swimmer.timestep * swimmer.substeps == pytest.approx(0.2)


def test_observation_is_guards(swimmer):
    angles = {f"jointpos_motor{i}_rot": 2 for i in (1, 2)}
    rates = {f"jointvel_motor{i}_rot": 1 for i in (1, 2)}
    touch = {f"touch_point{i}": 1 for i in (1, 2, 3, 4)}
    assert sizes(swimmer) == {
        "accelerometer": 3, "gyro": 3, **angles, **rates, "magnetometer": 3, **touch, "velocimeter": 3,
    }  # fmt: skip
    assert sum(sizes(swimmer).values()) == 22


@pytest.mark.parametrize("engine", ENGINES)
def test_every_link_lies_on_the_floor_with_its_own_weight(swimmer, engine):
    states = drive(engine, swimmer, 0.0, 5)
    rows = [swimmer.link_index(name) for name in LINKS]
    np.testing.assert_allclose(states[-1].link_position[0, rows, 2], 0.02, atol=1e-3)
    assert np.abs(states[-1].joint_velocity).max() < 1e-3
    read = readings(swimmer, states)
    both_ends = read["touch_point1"] + read["touch_point2"]
    assert both_ends[0, 0] == pytest.approx(0.222006 * 9.81, rel=0.02)


@pytest.mark.parametrize("engine", ENGINES)
def test_random_controls_move_it_as_fast_as_in_guard(swimmer, engine):
    """GUARD's Swimmer: 0.13 m/s of the centre of mass on average, where half of its contacts are missed by rounding."""
    states = drive(engine, swimmer, random_controls(swimmer, 4), 25, num_worlds=4)
    centres = np.array([centre_of_mass(swimmer, state)[:, :2] for state in states])
    speed = np.linalg.norm(np.diff(centres, axis=0), axis=2).mean() / 0.2
    assert 0.08 < speed < 0.22
    assert not diverged(states, speed=12.0)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_survives_random_controls(swimmer, engine):
    assert not diverged(drive(engine, swimmer, random_controls(swimmer, 2), 1000, num_worlds=2), speed=20.0)
