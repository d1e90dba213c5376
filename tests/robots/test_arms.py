"""Arm3 and Arm6: GUARD's numbers, kinematic joints, and a floor that stops them on every engine."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.model.library import load_robot
from guard_api.physics.transition import SnapshotReader
from tests.robots.motion import ENGINES, diverged, drive, of_geometry, random_controls, readings, sizes

SPEED = {"arm3": 0.6, "arm6": 0.4}
MASSES = {"arm3": 0.0023693, "arm6": 0.0026101}
INERTIAL = ("accelerometer", "gyro", "magnetometer", "velocimeter")


@pytest.fixture(scope="module", params=["arm3", "arm6"])
def arm(request):
    return load_robot(request.param)


def test_robot_is_guards(arm):
    assert sum(link.mass for link in arm.links) == pytest.approx(MASSES[arm.name], abs=5e-8)
    parts = [0.000335103, 0.00120166, 0.000335103, 0.000356047, 0.000141372, 0.000198968, 0.0000418879]
    split = {"arm3": [parts[0], parts[1], sum(parts[2:5])], "arm6": [*parts[:5], sum(parts[5:])]}[arm.name]
    assert [link.mass for link in arm.links[1:]] == pytest.approx(split, rel=3e-6)
    for link in arm.links[1:]:
        geometry = of_geometry(link, 0.01)
        np.testing.assert_allclose(link.inertia, geometry.inertia, rtol=1e-9, atol=1e-16)
        np.testing.assert_allclose(link.com, geometry.com, atol=1e-12)
    assert {joint.damping for joint in arm.joints} == {5000.0}
    axes = [(0, 0, 1), (1, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0)]
    assert [joint.axis for joint in arm.joints] == axes[: len(arm.joints)]


def test_observation_is_guards(arm):
    links, joints = {"arm3": (5, 3), "arm6": (7, 6)}[arm.name]
    feel = {f"{kind}_link_{i}": 3 for kind in INERTIAL for i in range(1, links + 1)}
    angles = {f"jointpos_joint_{i}": 2 for i in range(1, joints + 1)}
    rates = {f"jointvel_joint_{i}": 1 for i in range(1, joints + 1)}
    expected = dict(sorted({**feel, **angles, **rates, "touch_end_effector": 1}.items()))
    assert list(sizes(arm).items()) == list(expected.items())
    assert sum(expected.values()) == {"arm3": 70, "arm6": 103}[arm.name]


def test_end_effector_segments_and_lidars_are_where_guard_has_them(arm):
    state = drive("ideal", arm, 0.0, 1)[-1]
    rest = {"bodies": {}, "origins": {}, "slices": {}, "steps_since_success": np.zeros(1, np.int64)}
    seen = SnapshotReader(arm).read(state, **rest)
    reach = {"arm3": 1.0, "arm6": 1.5}[arm.name]
    np.testing.assert_allclose(seen.position, [[0, reach, 1.8]], atol=1e-5)
    low, elbow, hand = [0, 0, 0.3], [0, 0, 1.8], [0, 1, 1.8]
    sensing = [low, elbow, hand, [0, 1.5, 1.8]][: {"arm3": 3, "arm6": 4}[arm.name]]
    np.testing.assert_allclose(seen.sensing_position[0], sensing, atol=1e-5)
    origins = [low, low, elbow, elbow, hand, hand, [0, 1.5, 1.8]][: len(seen.segment_radius) + 1]
    np.testing.assert_allclose(seen.segment_start[0], origins[:-1], atol=1e-5)
    np.testing.assert_allclose(seen.segment_end[0], origins[1:], atol=1e-5)
    assert list(seen.segment_radius) == [0.2, 0.15, 0.2, 0.1, 0.15, 0.1][: len(seen.segment_radius)]


def test_joints_turn_at_guards_speed_without_transient(arm, backend_name):
    control = np.linspace(-1.0, 1.0, len(arm.joints))
    first, second = drive(backend_name, arm, control, 2)[1:]
    for state in (first, second):
        np.testing.assert_allclose(state.joint_velocity[0], SPEED[arm.name] * control, rtol=1e-3, atol=1e-4)


def test_gravity_does_not_bend_it(arm, backend_name):
    """The weight's largest torque, 0.03 N m, moves a joint of damping 5000 N m s by 6e-6 rad/s."""
    level = drive(backend_name, arm, 0.0, 10, place={"joint_2": -np.pi / 2, "joint_3": np.pi / 2})
    assert np.abs(level[-1].joint_velocity).max() < 1e-5
    assert readings(arm, level)["accelerometer_link_1"][0] == pytest.approx([0.0, 0.0, 9.81], abs=1e-3)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_floor_stops_it(arm, engine):
    """The elbow, a ball of 0.2 m at the end of 1.5 m, meets the floor where cos(q) = -0.1 / 1.5."""
    control = np.zeros(len(arm.joints))
    control[1] = 1.0
    states = drive(engine, arm, control, 30, place={"joint_2": 1.5})
    assert states[-1].joint_position[0, 1] == pytest.approx(np.arccos(-0.1 / 1.5), abs=0.005)
    assert np.abs(states[-1].joint_velocity[0]).max() < 0.02
    assert not diverged(states, speed=1.5)


@pytest.mark.parametrize("engine", ENGINES)
def test_end_effector_feels_the_floor(arm, engine):
    """It leans back and reaches down to a few hundredths of a radian above the floor; the drive has kN m to press."""
    place = {"arm3": {"joint_2": 1.2, "joint_3": -1.9}, "arm6": {"joint_2": 0.6, "joint_3": -2.51}}[arm.name]
    control = np.zeros(len(arm.joints))
    control[2] = {"arm3": -1.0, "arm6": 1.0}[arm.name]
    states = drive(engine, arm, control, 20, place=place)
    assert readings(arm, states[:2])["touch_end_effector"][0, 0] == 0.0
    assert readings(arm, states)["touch_end_effector"][0, 0] > 100.0


@pytest.mark.parametrize("steps", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_follows_random_controls(arm, backend_name, steps):
    noise = random_controls(arm, 2)
    states = drive(backend_name, arm, noise, steps, num_worlds=2)
    assert not diverged(states, speed=4.0)
    if steps == 40:  # too short to reach anything
        travel = SPEED[arm.name] * arm.timestep * arm.substeps * sum(noise(step) for step in range(steps))
        np.testing.assert_allclose(states[-1].joint_position, travel, atol=1e-3)
