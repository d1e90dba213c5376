"""Humanoid: GUARD's numbers, and legs that push against the floor on every engine."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api import rotations
from guard_api.model.library import load_robot, robot_files
from guard_api.model.robot import PLANAR_JOINTS
from guard_api.shapes import Sphere
from tests.model.mjcf_comparison import Pair
from tests.robots.motion import ENGINES, diverged, drive, random_controls, sizes

LEG = ("hip_x", "hip_y", "hip_z", "knee")
FOOT = (0.0, 0.0, -0.37)
"""Centre of a foot [m] in the axes of its shin's link, whose origin is the knee."""


@pytest.fixture(scope="module")
def humanoid():
    return load_robot("humanoid")


def test_the_file_is_the_robot_that_mujoco_makes_of_it(humanoid):
    text = next(file for file in robot_files("humanoid") if file.suffix == ".xml").read_text()
    pair = Pair(humanoid, text, ("x", "y", "yaw"))
    pair.assert_same()
    pair.assert_same_actuation()
    assert humanoid.notes == ()


def test_masses_are_guards(humanoid):
    masses = {link.name: link.mass for link in humanoid.links if not link.virtual}
    foot = 1.76715  # a body of its own in GUARD, welded to the shin
    expected = {"robot": 8.90746, "lower_waist": 2.26195, "pelvis": 6.61619}
    for side in ("right", "left"):
        expected |= {f"{side}_thigh": 4.75175, f"{side}_shin": 2.7557 + foot}
        expected |= {f"{side}_upper_arm": 1.66108, f"{side}_lower_arm": 1.22954}
    assert masses == pytest.approx(expected, rel=3e-6)
    assert sum(masses.values()) == pytest.approx(42.1160, abs=5e-5)


def test_base_keeps_its_height_and_turns_freely(humanoid):
    assert (humanoid.base, humanoid.home.height, humanoid.collide_ground) == ("planar", 1.28, True)
    base = {joint.name: (joint.armature, joint.damping, joint.stiffness) for joint in humanoid.joints[:3]}
    assert base == dict(zip(PLANAR_JOINTS, [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (10.0, 1.0, 0.0)], strict=True))


def test_joints_are_guards(humanoid):
    """Limits [deg], axis, armature, damping and stiffness."""
    s, t = 6.0**-0.5, 2.0**-0.5
    expected = {
        "abdomen_z": (None, (0, 0, 1), 0.02, 5, 1),
        "abdomen_y": ([-75, 30], (0, 1, 0), 0.02, 5, 10),
        "abdomen_x": ([-35, 35], (1, 0, 0), 0.02, 5, 10),
        "right_knee": ([-160, -2], (0, -1, 0), 0.006, 1, 0),
        "left_knee": ([-160, -2], (0, -1, 0), 0.006, 1, 1),
        "right_shoulder1": ([-85, 60], (2 * s, s, s), 0.0068, 1, 1),
        "right_shoulder2": ([-85, 60], (0, -t, t), 0.0051, 1, 1),
        "right_elbow": ([-90, 50], (0, -t, t), 0.0028, 1, 0),
        "left_shoulder1": ([-60, 85], (2 * s, -s, s), 0.0068, 1, 1),
        "left_shoulder2": ([-60, 85], (0, t, t), 0.0051, 1, 1),
        "left_elbow": ([-90, 50], (0, -t, -t), 0.0028, 1, 0),
    }
    for side, mirror in (("right", 1), ("left", -1)):
        expected |= {
            f"{side}_hip_x": ([-25, 5], (mirror, 0, 0), 0.01, 5, 10),
            f"{side}_hip_z": ([-60, 35], (0, 0, mirror), 0.01, 5, 10),
            f"{side}_hip_y": ([-110, 20], (0, 1, 0), 0.01, 5, 20),
        }
    joints = {joint.name: joint for joint in humanoid.joints[3:]}
    assert joints.keys() == expected.keys()
    for name, (limits, axis, *dynamics) in expected.items():
        joint = joints[name]
        assert (joint.limits and np.degrees(joint.limits).tolist()) == (limits and pytest.approx(limits)), name
        np.testing.assert_allclose(joint.axis, axis, atol=1e-12, err_msg=name)
        assert [joint.armature, joint.damping, joint.stiffness] == dynamics, name
        assert joint.rest_position == 0.0


def test_actuators_and_settings_are_guards(humanoid):
    gears = {"hip_x": 20.0, "hip_z": 20.0, "hip_y": 40.0, "knee": 15.0}
    expected = [(f"{side}_{name}", gear) for side in ("right", "left") for name, gear in gears.items()]
    assert [(actuator.joint, actuator.gear) for actuator in humanoid.actuators] == expected
    assert {(actuator.law, actuator.ctrl_range) for actuator in humanoid.actuators} == {("effort", (-1.0, 1.0))}
    assert (humanoid.timestep, humanoid.substeps, humanoid.keepout) == (0.003, 10, 0.4)
    assert {part.friction for link in humanoid.links for part in link.collisions} == {1.0}


def test_observation_is_guards(humanoid):
    angles = {f"jointpos_{side}_{name}": 2 for side in ("left", "right") for name in LEG}
    rates = {f"jointvel_{side}_{name}": 1 for side in ("left", "right") for name in LEG}
    touch = {"touch_left_foot": 1, "touch_right_foot": 1}
    expected = {
        "accelerometer": 3, "gyro": 3, **angles, **rates, "magnetometer": 3, **touch, "velocimeter": 3,
    }  # fmt: skip
    assert list(sizes(humanoid).items()) == list(expected.items())
    assert sum(expected.values()) == 38
    felt = {sensor.name: (sensor.link, sensor.pose.position, sensor.radius) for sensor in humanoid.touch_sensors}
    assert felt == {f"touch_{side}_foot": (f"{side}_shin", FOOT, 0.1) for side in ("right", "left")}


def test_starts_inside_its_limits_with_feet_just_touching_the_floor(humanoid):
    for joint in humanoid.joints:
        lower, upper = joint.limits or (-np.inf, np.inf)
        assert lower - 1e-15 <= humanoid.home.joint_position.get(joint.name, 0.0) <= upper + 1e-15
    start = drive("ideal", humanoid, 0.0, 0)[0]
    for side in ("right", "left"):
        shin = humanoid.link_index(f"{side}_shin")
        ball = next(part for part in humanoid.links[shin].collisions if part.pose.position == FOOT)
        assert ball.shape == Sphere(radius=0.075)
        centre = start.link_position[0, shin] + rotations.rotate(start.link_quaternion[0, shin], FOOT)
        assert centre[2] == pytest.approx(0.075, abs=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_rests_on_its_feet_as_in_guard(humanoid, engine):
    """GUARD: about 62 N on each foot, knees locked, the legs leaning forward from the waist by 5.9 degrees."""
    states = drive(engine, humanoid, 0.0, 60)
    force = np.mean([state.touch[0] for state in states[-20:]], axis=0)
    assert force == pytest.approx([62.0, 62.0], rel=0.06)
    assert np.degrees(states[-1].joint_position[0, humanoid.joint_index("abdomen_y")]) == pytest.approx(-5.9, abs=0.3)
    assert states[-1].link_position[0, humanoid.link_index("robot"), 2] == pytest.approx(1.28, abs=1e-6)
    assert np.linalg.norm(states[-1].joint_position[0, :2]) < 0.02


@pytest.mark.parametrize("steps", [60, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("engine", ENGINES)
def test_random_controls_move_it_on_its_feet(humanoid, engine, steps):
    """GUARD: 0.13 m/s forward and a mean force of 70 N on both feet, under the same kind of controls."""
    states = drive(engine, humanoid, random_controls(humanoid, 2), steps, num_worlds=2)
    assert not diverged(states, speed=5.0)
    force = np.array([state.touch.sum(axis=1) for state in states[1:]])
    assert 30.0 < force.mean() < 200.0
    assert states[-1].joint_position[:, 0].min() > 0.0
