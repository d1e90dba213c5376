"""Hopper: GUARD's numbers, and a leg that pushes against the floor on every engine."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.model.library import load_robot, robot_files
from guard_api.model.robot import PLANAR_JOINTS
from guard_api.shapes import Sphere
from tests.model.mjcf_comparison import Pair
from tests.robots.motion import ENGINES, diverged, drive, random_controls, sizes


@pytest.fixture(scope="module")
def hopper():
    return load_robot("hopper")


def test_the_file_is_the_robot_that_mujoco_makes_of_it(hopper):
    text = next(file for file in robot_files("hopper") if file.suffix == ".xml").read_text()
    pair = Pair(hopper, text, ("x", "y", "yaw"))
    pair.assert_same()
    pair.assert_same_actuation()
    assert hopper.notes == ()


def test_masses_are_guards(hopper):
    masses = {link.name: link.mass for link in hopper.links if not link.virtual}
    assert masses == pytest.approx({"robot": 3.66519, "thigh": 4.05789, "leg": 2.78136, "foot": 1.76715}, rel=3e-6)
    assert sum(masses.values()) == pytest.approx(12.2716, abs=5e-5)


def test_joints_are_guards(hopper):
    """Limits [deg], axis, armature, damping and stiffness."""
    assert (hopper.base, hopper.home.height, hopper.collide_ground) == ("planar", 1.2, True)
    hip = (0.01, 5, 10)
    expected = dict(
        zip(PLANAR_JOINTS, [(None, (1, 0, 0), 0, 10, 0), (None, (0, 1, 0), 0, 10, 0), (None, (0, 0, 1), 0, 1, 0)],
            strict=True)
    ) | {
        "hip_x": ([-20, 20], (1, 0, 0), *hip),
        "hip_z": ([-20, 20], (0, 0, 1), *hip),
        "hip_y": ([-20, 20], (0, 1, 0), *hip),
        "thigh_joint": ([-150, 0], (0, -1, 0), 1, 1, 0),
        "leg_joint": ([-100, 0], (0, -1, 0), 1, 1, 0),
        "foot_joint": ([-45, 45], (0, -1, 0), 1, 1, 0),
    }  # fmt: skip
    assert list(hopper.joint_names) == list(expected)
    for joint, (limits, axis, *dynamics) in zip(hopper.joints, expected.values(), strict=True):
        assert (joint.limits and np.degrees(joint.limits).tolist()) == (limits and pytest.approx(limits)), joint.name
        np.testing.assert_allclose(joint.axis, axis, atol=1e-12, err_msg=joint.name)
        assert [joint.armature, joint.damping, joint.stiffness] == dynamics, joint.name
        assert joint.rest_position == 0.0


def test_actuators_have_guards_largest_torques(hopper):
    """GUARD's hips have gear 20 and clip their controls at 0.4; here controls are scaled."""
    expected = [("hip_x", 8), ("hip_z", 8), ("hip_y", 8), ("thigh_joint", 50), ("leg_joint", 20), ("foot_joint", 20)]
    assert [(actuator.joint, actuator.gear) for actuator in hopper.actuators] == expected
    assert {(actuator.law, actuator.ctrl_range) for actuator in hopper.actuators} == {("effort", (-1.0, 1.0))}
    assert (hopper.timestep, hopper.substeps, hopper.keepout) == (0.005, 10, 0.4)
    assert {part.friction for link in hopper.links for part in link.collisions} == {1.0}


def test_observation_is_guards(hopper):
    joints = ("foot", "hip_x", "hip_y", "hip_z", "leg", "thigh")
    angles, rates = {f"jointpos_{name}": 2 for name in joints}, {f"jointvel_{name}": 1 for name in joints}
    expected = {
        "accelerometer": 3, "gyro": 3, **angles, **rates, "magnetometer": 3, "touch_foot": 1, "velocimeter": 3,
    }  # fmt: skip
    assert list(sizes(hopper).items()) == list(expected.items())
    assert sum(expected.values()) == 31
    read = {sensor.name: sensor.joint for sensor in hopper.sensors if sensor.joint}
    assert (read["jointpos_leg"], read["jointvel_hip_z"]) == ("leg_joint", "hip_z")
    (touch,) = hopper.touch_sensors
    assert (touch.link, touch.pose.position, touch.radius) == ("foot", (0.0, 0.0, 0.0), 0.2)


def test_starts_inside_its_limits_with_the_foot_just_touching_the_floor(hopper):
    for joint in hopper.joints[3:]:
        assert joint.limits
        assert joint.limits[0] <= hopper.home.joint_position.get(joint.name, 0.0) <= joint.limits[1]
    foot = hopper.link_index("foot")
    assert [part.shape for part in hopper.links[foot].collisions] == [Sphere(radius=0.075)]
    height = drive("ideal", hopper, 0.0, 0)[0].link_position[0, foot, 2]
    assert height == pytest.approx(0.075, abs=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_rests_on_its_foot_as_in_guard(hopper, engine):
    """GUARD: 31.0 N. The shin turns freely about the knee, so its weight half way down and the foot's all count."""
    states = drive(engine, hopper, 0.0, 40)
    force = np.mean([state.touch[0, 0] for state in states[-10:]])
    assert force == pytest.approx(9.81 * (0.5 * 2.78136 + 1.76715), rel=0.01)
    assert force == pytest.approx(31.0, rel=0.01)
    assert np.abs(states[-1].joint_velocity).max() < 0.01
    assert np.linalg.norm(states[-1].joint_position[0, :2]) < 0.003


@pytest.mark.parametrize("steps", [60, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("engine", ENGINES)
def test_random_controls_move_it_on_its_foot(hopper, engine, steps):
    """GUARD: a mean force of 25 N, in contact in 40 % of the steps, under the same kind of controls."""
    states = drive(engine, hopper, random_controls(hopper, 2), steps, num_worlds=2)
    assert not diverged(states, speed=4.0)
    force = np.array([state.touch[:, 0] for state in states[1:]])
    assert 12.0 < force.mean() < 60.0
    assert 0.1 < (force > 0.0).mean() < 0.8
