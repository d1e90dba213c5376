"""Point: GUARD's numbers, and an inertial that is what its geometry gives."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.errors import SpecError
from guard_api.model.inertia import of_solids
from guard_api.model.library import load_robot, robot_files, robot_names, shipped_root
from guard_api.model.robot import PLANAR_JOINTS
from guard_api.physics.actuation import ActuationLaw
from guard_api.shapes import Box, Sphere


@pytest.fixture
def point():
    return load_robot("point")


def test_mass_and_centre_are_those_of_guard(point) -> None:
    body = point.links[point.link_index("robot")]
    assert body.mass == pytest.approx(0.00518879, abs=5e-9)
    assert body.com == pytest.approx((0.01927, 0.0, 0.0), abs=5e-6)


def test_inertial_is_that_of_its_geometry_at_density_one(point) -> None:
    body = point.links[point.link_index("robot")]
    assert [type(part.shape) for part in body.collisions] == [Sphere, Box]
    computed = of_solids([(part.shape, part.pose) for part in body.collisions], 1.0)
    assert body.mass == pytest.approx(computed.mass, rel=1e-15)
    np.testing.assert_allclose(body.com, computed.com, rtol=1e-15)
    np.testing.assert_allclose(body.inertia, computed.inertia, rtol=1e-15, atol=1e-20)


def test_inertia_by_hand(point) -> None:
    ball, box = 4.0 / 3.0 * np.pi * 0.1**3, 0.1**3
    distance = 0.1  # between the centres; the reduced mass gives the parallel-axis term of two bodies
    steiner = ball * box / (ball + box) * distance**2
    about_x = 0.4 * ball * 0.1**2 + box * 0.1**2 / 6.0
    body = point.links[point.link_index("robot")]
    np.testing.assert_allclose(body.inertia, np.diag([about_x, about_x + steiner, about_x + steiner]), atol=1e-19)


def test_planar_base_stands_at_home_height(point) -> None:
    assert point.base == "planar"
    assert point.joint_names == PLANAR_JOINTS
    assert [joint.kind for joint in point.joints] == ["prismatic", "prismatic", "continuous"]
    assert [joint.damping for joint in point.joints] == [0.01, 0.01, 0.005]
    assert [joint.axis for joint in point.joints] == [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    assert sum(joint.origin.position[2] for joint in point.joints) == point.home.height == 0.1
    assert [link.virtual for link in point.links] == [True, True, True, False]
    assert [joint.child for joint in point.joints] == list(point.link_names[1:])
    assert point.root == point.link_names[-1] == "robot"
    assert not point.collide_ground


def test_settings_are_those_of_guard(point) -> None:
    assert (point.timestep, point.substeps, point.keepout) == (0.002, 10, 0.4)
    assert [sensor.name for sensor in point.sensors] == ["accelerometer", "velocimeter", "gyro", "magnetometer"]
    assert {sensor.link for sensor in point.sensors} == {"robot"}
    assert point.licence
    assert point.notes == ()


@pytest.mark.parametrize("control", [-2.0, -0.7, -0.01, 0.0, 0.03, 1.0])
@pytest.mark.parametrize("omega", [-4.0, 0.0, 0.05, 3.0])
def test_actuators_follow_guards_formulas(point, control: float, omega: float) -> None:
    law = ActuationLaw(point)
    geared = law.geared(np.full((1, 2), control))
    u = np.clip(control, -1.0, 1.0)
    np.testing.assert_allclose(law.thrust(geared)[0, 0], [np.clip(0.3 * u, -0.015, 0.015), 0.0, 0.0], atol=1e-17)
    torque = law.joint_effort(geared, np.zeros((1, 3)), np.array([[0.0, 0.0, omega]]))[0]
    np.testing.assert_allclose(torque, [0.0, 0.0, np.clip(0.3 * (u - 0.3 * omega), -0.015, 0.015)], atol=1e-16)


def test_the_library_finds_it() -> None:
    assert "point" in robot_names()
    assert [file.name for file in robot_files("point")] == ["point.urdf", "robot.toml"]
    assert all(shipped_root() in file.parents for file in robot_files("point"))
    assert load_robot("point") is load_robot("point")


def test_an_unknown_robot_names_the_nearest() -> None:
    with pytest.raises(SpecError, match="did you mean point"):
        load_robot("pont")


@pytest.mark.parametrize("name", robot_names())
def test_every_shipped_robot_is_complete(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    assert robot.licence, "state the licence"
    assert robot.actuators
    assert [joint.child for joint in robot.joints] == list(robot.link_names[1:])
