"""Car: GUARD's numbers, driving and turning on every engine."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api import rotations
from guard_api.model.library import load_robot
from tests.robots.motion import ENGINES, diverged, drive, of_geometry, random_controls, readings, sizes


@pytest.fixture(scope="module")
def car():
    return load_robot("car")


def yaw_rate(states):
    """Return the mean over the second half [rad/s]; link 0 is the body."""
    return float(np.mean([state.link_angular_velocity[0, 0, 2] for state in states[len(states) // 2 :]]))


def test_robot_is_guards(car):
    masses = {link.name: link.mass for link in car.links if not link.virtual}
    expected = {"robot": 0.0239, "left": 0.0019635, "right": 0.0019635, "rear": 0.00261799}
    assert masses == pytest.approx(expected, rel=3e-6)
    assert sum(masses.values()) == pytest.approx(0.030445, abs=5e-7)
    for link in car.links:
        if not link.virtual:
            geometry = of_geometry(link, 5.0)
            np.testing.assert_allclose(link.inertia, geometry.inertia, rtol=1e-10, atol=1e-16)
            np.testing.assert_allclose(link.com, geometry.com, atol=1e-14)
    assert {joint.damping for joint in car.joints} == {0.001}
    assert [actuator.effort_limit for actuator in car.actuators] == [0.02, 0.02]
    assert (car.base, car.home.height, car.timestep, car.substeps) == ("floating", 0.1, 0.004, 10)


def test_observation_is_guards(car):
    assert sizes(car) == {
        "accelerometer": 3, "ballangvel_rear": 3, "ballquat_rear": 9, "gyro": 3, "magnetometer": 3, "velocimeter": 3,
    }  # fmt: skip
    assert sum(sizes(car).values()) == 24


@pytest.mark.parametrize("engine", ENGINES)
def test_rests_on_its_wheels(car, engine):
    states = drive(engine, car, 0.0, 40)
    assert states[-1].link_position[0, 0, 2] == pytest.approx(0.0999, abs=5e-4)
    assert np.linalg.norm(states[-1].link_position[0, 0, :2]) < 0.005
    assert np.abs(states[-1].link_linear_velocity[0, 0]).max() < 0.01


def test_drives_forward_as_in_guard(car):
    """GUARD: 0.81 m/s along -y after 8 s."""
    states = drive("mujoco", car, 1.0, 200)
    velocity = states[-1].link_linear_velocity[0, 0]
    assert -velocity[1] == pytest.approx(0.81, rel=0.03)
    assert abs(velocity[0]) < 0.05


def test_turns_on_the_spot_as_in_guard_under_its_contact_settings(car):
    """GUARD: 1.4 rad/s. It is all slip, hence a matter of the contact model: 0.87 rad/s with stiff contacts."""
    native, rigid = (drive("mujoco", car, (1.0, -1.0), 200, preset=preset) for preset in ("native", "rigid"))
    assert yaw_rate(native) == pytest.approx(1.4, rel=0.2)
    assert yaw_rate(rigid) == pytest.approx(0.87, rel=0.1)
    assert np.linalg.norm(rigid[-1].link_position[0, 0, :2]) < 0.2


@pytest.mark.parametrize("engine", ENGINES)
def test_drives_and_turns_on_every_engine(car, engine):
    ahead = drive(engine, car, 1.0, 60)[-1].link_linear_velocity[0, 0]
    assert 0.3 < -ahead[1] < 0.9
    assert abs(ahead[0]) < 0.25
    assert 0.5 < yaw_rate(drive(engine, car, (1.0, -1.0), 60)) < 4.0


@pytest.mark.parametrize("engine", ENGINES)
def test_rear_ball_reads_a_rotation_that_turns_as_the_gyro_of_the_ball_says(car, engine):
    states = drive(engine, car, (1.0, 0.5), 30)
    read = readings(car, states)
    matrix = read["ballquat_rear"].reshape(3, 3)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)
    body, rear = 0, car.link_index("rear")
    spin = states[-1].link_angular_velocity[0, rear] - states[-1].link_angular_velocity[0, body]
    expected = rotations.unrotate(states[-1].link_quaternion[0, rear], spin)
    np.testing.assert_allclose(read["ballangvel_rear"][0], expected, atol=1e-6)
    assert np.linalg.norm(expected) > 1.0


@pytest.mark.parametrize("steps", [40, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("engine", ENGINES)
def test_survives_full_throttle_in_random_directions(car, engine, steps):
    noise = random_controls(car, 2)
    states = drive(engine, car, lambda step: np.sign(noise(step // 5)), steps, num_worlds=2)
    assert not diverged(states, speed=2.0)
    assert max(float(state.link_position[:, 0, 2].max()) for state in states) < 0.13
