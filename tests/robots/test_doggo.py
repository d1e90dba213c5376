"""Doggo: GUARD's numbers, and standing on four legs on every engine."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.model.library import load_robot, robot_files
from tests.model.mjcf_comparison import Pair
from tests.robots.motion import ENGINES, diverged, drive, random_controls, readings, sizes

WEIGHT = 0.039680 * 9.81


@pytest.fixture(scope="module")
def doggo():
    return load_robot("doggo")


def test_the_file_is_the_robot_that_mujoco_makes_of_it(doggo):
    text = next(file for file in robot_files("doggo") if file.suffix == ".xml").read_text()
    pair = Pair(doggo, text)
    pair.assert_same()
    pair.assert_same_actuation()
    assert doggo.notes == ()


def test_masses_are_guards(doggo):
    masses = {link.name: link.mass for link in doggo.links if not link.virtual}
    half = 0.00176715 + 2 * 0.00296105  # of the body, with the two upper legs welded to it
    expected = {"robot": half, "rear": half}
    expected |= {f"aux_{i}": 0.00267638 for i in range(1, 5)} | {f"shin_{i}": 0.00339889 for i in range(1, 5)}
    assert masses == pytest.approx(expected, rel=3e-6)
    assert sum(masses.values()) == pytest.approx(0.039680, abs=5e-7)


def test_joints_are_guards(doggo):
    """Limits [deg], axis and rest position [deg]; all are springs of 0.01 N m/rad without damping."""
    expected: dict[str, tuple[list[int], tuple[float, float, float], int]] = {"waist_x": ([-30, 30], (1, 0, 0), 0)}
    for i, mirror in ((1, 1), (2, 1), (3, -1), (4, -1)):
        expected[f"hip_{i}_z"] = ([-10, 30], (0, 0, mirror), 0)
        expected[f"hip_{i}_y"] = ([-75, 15], (0, 1, 0), -10) if i in {1, 4} else ([0, 135], (0, 1, 0), 0)
        expected[f"ankle_{i}"] = ([-75, 0], (-0.5 * mirror, 0.866, 0), -20)
    joints = {joint.name: joint for joint in doggo.joints}
    assert joints.keys() == expected.keys()
    for name, (limits, axis, rest) in expected.items():
        joint = joints[name]
        assert joint.limits and np.degrees(joint.limits) == pytest.approx(limits), name
        np.testing.assert_allclose(joint.axis, axis, atol=2e-5, err_msg=name)
        assert np.degrees(joint.rest_position) == pytest.approx(rest), name
        assert (joint.stiffness, joint.damping, joint.armature) == (0.01, 0.0, 0.0), name


def test_actuators_and_settings_are_guards(doggo):
    order = [f"hip_{i}_{axis}" for axis in "zy" for i in range(1, 5)] + [f"ankle_{i}" for i in range(1, 5)]
    assert [actuator.joint for actuator in doggo.actuators] == order
    assert {(a.law, a.gear, a.ctrl_range) for a in doggo.actuators} == {("effort", 0.0125, (-1.0, 1.0))}
    assert (doggo.base, doggo.home.height, doggo.home.joint_position) == ("floating", 0.22, {})
    assert (doggo.timestep, doggo.substeps, doggo.keepout) == (0.01, 10, 0.4)
    assert {part.friction for link in doggo.links for part in link.collisions} == {1.0}


def test_observation_is_guards(doggo):
    joints = [f"ankle_{i}" for i in range(1, 5)] + [f"hip_{i}_{axis}" for i in range(1, 5) for axis in "yz"]
    angles, rates = {f"jointpos_{name}": 2 for name in joints}, {f"jointvel_{name}": 1 for name in joints}
    touch = {f"touch_ankle_{i}{end}": 1 for i in range(1, 5) for end in "ab"}
    expected = {
        "accelerometer": 3, "gyro": 3, **angles, **rates, "magnetometer": 3, **touch, "velocimeter": 3,
    }  # fmt: skip
    assert list(sizes(doggo).items()) == list(expected.items())
    assert sum(expected.values()) == 56
    felt = {sensor.name: (sensor.link, sensor.pose.position, sensor.radius) for sensor in doggo.touch_sensors}
    assert felt["touch_ankle_3a"] == ("shin_3", (0.0, 0.0, 0.0), 0.036)
    assert felt["touch_ankle_1b"] == ("shin_1", (-0.1176, -0.0679, -0.1), 0.036)
    assert felt["touch_ankle_4b"] == ("shin_4", (-0.1176, 0.0679, -0.1), 0.036)


def test_legs_stand_where_guards_do(doggo):
    start = drive("ideal", doggo, 0.0, 0)[0]
    ankle = {i: start.link_position[0, doggo.link_index(f"shin_{i}")] for i in range(1, 5)}
    front, rear, aside, height = 0.298, -0.102, 0.1566, 0.17
    for i, x, y in ((1, front, aside), (2, rear, aside), (3, rear, -aside), (4, front, -aside)):
        np.testing.assert_allclose(ankle[i], (x, y, height), atol=1e-12)


def test_creeps_to_guards_rest_under_its_contact_settings(doggo):
    """GUARD: a height of 0.1613 m after a drift by 0.08 m, as its legs spread in the creep of soft friction."""
    body = doggo.link_index("robot")
    states = drive("mujoco", doggo, 0.0, 300, preset="native")
    assert states[-1].link_position[0, body, 2] == pytest.approx(0.1613, abs=1e-3)
    assert states[-1].link_position[0, body, 0] == pytest.approx(0.081, rel=0.05)


@pytest.mark.parametrize("engine", ENGINES)
def test_stands_with_its_weight_on_four_feet(doggo, engine):
    """Where friction holds the legs there are many rests: the engines' heights differ by 4 mm."""
    states = drive(engine, doggo, 0.0, 60)
    assert np.mean([state.touch[0].sum() for state in states[-20:]]) == pytest.approx(WEIGHT, rel=0.01)
    read = readings(doggo, states)
    assert min(read[f"touch_ankle_{i}b"][0, 0] for i in range(1, 5)) > 0.02
    body = doggo.link_index("robot")
    assert states[-1].link_position[0, body, 2] == pytest.approx(0.1613, abs=0.015)
    assert np.linalg.norm(states[-1].link_position[0, body, :2]) < 0.1
    assert np.abs(states[-1].link_linear_velocity[0, body]).max() < 0.05  # SAPIEN trembles by 0.02


@pytest.mark.parametrize("steps", [60, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("engine", ENGINES)
def test_random_controls_move_it_on_its_legs(doggo, engine, steps):
    states = drive(engine, doggo, random_controls(doggo, 2), steps, num_worlds=2)
    assert not diverged(states, speed=6.0)
    height = np.array([state.link_position[:, doggo.link_index("robot"), 2] for state in states])
    assert height.min() > 0.05
    assert height.max() < 0.3
    assert np.mean([state.touch.sum(axis=1) for state in states[10:]]) == pytest.approx(WEIGHT, rel=0.15)
