"""Ant and Walker: GUARD's numbers to the digits it is known by, and MuJoCo's own compilation of the same files."""

from __future__ import annotations

import math

import numpy as np
import pytest

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.library import load_robot, robot_files
from guard_api.model.robot import PLANAR_JOINTS, RobotModel
from guard_api.shapes import Capsule
from tests.model.mjcf_comparison import Pair

IMU = ["accelerometer", "gyro", "magnetometer", "velocimeter"]


def same_digits(value: float, printed: str) -> bool:
    """Whether `value`, rounded to as many digits, is what was printed."""
    digits = len(printed.split("e", maxsplit=1)[0].lstrip("0.").replace(".", ""))
    return float(f"{value:.{digits - 1}e}") == float(printed)


def angles(robot: RobotModel) -> dict[str, list[float]]:
    """Limits in degrees."""
    return {joint.name: [round(math.degrees(end), 9) for end in joint.limits] for joint in robot.joints if joint.limits}


def at_home(robot: RobotModel) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Link name -> its position and rotation matrix where an episode starts."""
    base = np.array([[0.0, 0.0, robot.home.height if robot.floating else 0.0]])
    q = np.array([[robot.home.joint_position.get(joint.name, 0.0) for joint in robot.joints]])
    poses = Kinematics(robot).poses(base, np.array([[1.0, 0.0, 0.0, 0.0]]), q)
    turns = rotations.to_matrix(poses.quaternion[0])
    return {name: (poses.position[0, i], turns[i]) for i, name in enumerate(robot.link_names)}


def lowest(robot: RobotModel, link: str) -> float:
    """Height of the lowest point of a link's capsules at home."""
    position, R = at_home(robot)[link]
    heights = []
    for part in robot.links[robot.link_index(link)].collisions:
        assert isinstance(part.shape, Capsule)
        axis = rotations.rotate(part.pose.quaternion, (0.0, 0.0, part.shape.half_length))
        centre = (position + R @ part.pose.position)[2]
        heights.append(centre - abs((R @ axis)[2]) - part.shape.radius)
    return min(heights)


@pytest.mark.parametrize(("name", "base"), [("ant", ()), ("walker", ("x", "y", "yaw"))])
def test_the_file_is_the_robot_that_mujoco_makes_of_it(name: str, base: tuple[str, ...]) -> None:
    text = next(file for file in robot_files(name) if file.suffix == ".xml").read_text()
    pair = Pair(load_robot(name), text, base)
    pair.assert_same()
    pair.assert_same_actuation()


@pytest.mark.parametrize("name", ["ant", "walker"])
def test_nothing_of_the_file_is_left_out(name: str) -> None:
    assert load_robot(name).notes == ()


@pytest.fixture(scope="module")
def ant() -> RobotModel:
    return load_robot("ant")


class TestAnt:
    def test_masses(self, ant: RobotModel) -> None:
        masses = {link.name: link.mass for link in ant.links}
        assert same_digits(sum(masses.values()), "0.0136431")
        for i in "1234":
            assert same_digits(masses[f"aux_{i}"], "0.00061184")
            assert same_digits(masses[f"shin_{i}"], "0.00105613")
        assert same_digits(masses["robot"] - 4.0 * masses["aux_1"], "0.00452389")

    def test_joints(self, ant: RobotModel) -> None:
        assert ant.base == "floating"
        limits = angles(ant)
        assert [limits[f"hip_{i}"] for i in "1234"] == [[-30, 30]] * 4
        assert [limits[f"ankle_{i}"] for i in "1234"] == [[30, 70], [-70, -30], [-70, -30], [30, 70]]
        assert {(joint.armature, joint.damping, joint.stiffness) for joint in ant.joints} == {(1.0, 1.0, 0.0)}
        s = 0.5**0.5
        axes = {joint.name: joint.axis for joint in ant.joints}
        np.testing.assert_allclose([axes[f"hip_{i}"] for i in "1234"], [(0, 0, 1)] * 4)
        np.testing.assert_allclose([axes[f"ankle_{i}"] for i in "1234"], [(-s, s, 0), (s, s, 0), (-s, s, 0), (s, s, 0)])

    def test_actuators_and_settings(self, ant: RobotModel) -> None:
        order = ["hip_1", "ankle_1", "hip_2", "ankle_2", "hip_3", "ankle_3", "hip_4", "ankle_4"]
        assert [(a.name, a.joint) for a in ant.actuators] == [(name, name) for name in order]
        assert {(a.law, a.gear, a.ctrl_range) for a in ant.actuators} == {("effort", 30.0, (-1.0, 1.0))}
        assert (ant.timestep, ant.substeps, ant.keepout, ant.collide_ground) == (0.02, 10, 0.4, True)
        assert {part.friction for link in ant.links for part in link.collisions} == {0.75}

    def test_observation_is_guards_in_its_order(self, ant: RobotModel) -> None:
        joints = [f"{kind}_{i}" for kind in ("ankle", "hip") for i in range(1, 5)]
        touch = [f"touch_ankle_{i}{end}" for i in range(1, 5) for end in "ab"]
        velocimeter = IMU[3]
        names = [*IMU[:2], *(f"jointpos_{j}" for j in joints), *(f"jointvel_{j}" for j in joints), IMU[2], *touch]
        assert sorted(sensor.name for sensor in ant.sensors) == [*names, velocimeter]
        sizes = {"joint_position": 2, "joint_velocity": 1, "touch": 1}
        assert sum(sizes.get(sensor.kind, 3) for sensor in ant.sensors) == 44
        felt = {sensor.name: sensor for sensor in ant.sensors if sensor.kind == "touch"}
        assert {sensor.radius for sensor in felt.values()} == {0.2}
        assert felt["touch_ankle_2a"].pose.position == (0.0, 0.0, 0.0)
        assert (felt["touch_ankle_2b"].link, felt["touch_ankle_2b"].pose.position) == ("shin_2", (-0.1, 0.1, 0.0))

    def test_it_starts_on_its_four_feet(self, ant: RobotModel) -> None:
        assert [lowest(ant, f"shin_{i}") for i in "1234"] == pytest.approx([0.0] * 4, abs=1e-12)
        for joint in ant.joints:
            assert joint.limits is not None
            assert joint.limits[0] <= ant.home.joint_position.get(joint.name, 0.0) <= joint.limits[1]

    def test_legs_point_where_guards_do(self, ant: RobotModel) -> None:
        feet = {i: at_home(ant)[f"shin_{i}"] for i in "1234"}
        tips = {i: p + R @ np.array(direction) for (i, (p, R)), direction in zip(
            feet.items(), [(0.1, 0.1, 0), (-0.1, 0.1, 0), (-0.1, -0.1, 0), (0.1, -0.1, 0)], strict=True
        )}  # fmt: skip
        signs = [tuple(np.sign(tips[i][:2])) for i in "1234"]
        assert signs == [(1, 1), (-1, 1), (-1, -1), (1, -1)]


@pytest.fixture(scope="module")
def walker() -> RobotModel:
    return load_robot("walker")


class TestWalker:
    def test_masses(self, walker: RobotModel) -> None:
        masses = {link.name: link.mass for link in walker.links}
        assert same_digits(sum(masses.values()), "1.55718")
        assert same_digits(masses["robot"], "0.339292")
        for side in ("left", "right"):
            assert same_digits(masses[f"{side}_thigh"], "0.339292")
            assert same_digits(masses[f"{side}_leg"], "0.142419")
            assert same_digits(masses[f"{side}_foot"], "0.127235")

    def test_it_slides_and_turns_in_the_plane(self, walker: RobotModel) -> None:
        assert (walker.base, walker.home.height, walker.collide_ground) == ("planar", 0.43, True)
        base = walker.joints[:3]
        assert tuple(joint.name for joint in base) == PLANAR_JOINTS
        assert [joint.damping for joint in base] == [5.0, 5.0, 1.0]
        assert {(joint.armature, joint.stiffness, joint.limits) for joint in base} == {(0.0, 0.0, None)}

    def test_joints(self, walker: RobotModel) -> None:
        legs = {
            "hip_x": ([-25, 5], (1, 0, 0), (0.01, 5.0, 10.0)),
            "hip_z": ([-30, 35], (0, 0, 1), (0.01, 5.0, 10.0)),
            "hip_y": ([-100, 10], (0, 1, 0), (0.01, 5.0, 10.0)),
            "leg": ([-100, 0], (0, -1, 0), (1.0, 20.0, 0.0)),
            "foot": ([-45, 20], (0, -1, 0), (1.0, 20.0, 0.0)),
        }
        limits, joints = angles(walker), {joint.name: joint for joint in walker.joints}
        for side, mirror in (("right", 1.0), ("left", -1.0)):
            for name, (range_, axis, dynamics) in legs.items():
                joint = joints[f"{side}_{name}"]
                assert limits[joint.name] == range_
                sign = mirror if name in {"hip_x", "hip_z"} else 1.0
                np.testing.assert_allclose(joint.axis, sign * np.array(axis), atol=1e-15)
                assert (joint.armature, joint.damping, joint.stiffness) == dynamics

    def test_joints_are_where_guards_are(self, walker: RobotModel) -> None:
        where = at_home(walker)
        for side, y in (("right", 0.1), ("left", -0.1)):
            for link, z in (("thigh", 0.43), ("leg", 0.23), ("foot", 0.03)):
                np.testing.assert_allclose(where[f"{side}_{link}"][0], (0.0, y, z), atol=1e-15)

    def test_actuators_and_settings(self, walker: RobotModel) -> None:
        gears = {"hip_x": 10.0, "hip_z": 10.0, "hip_y": 30.0, "leg": 30.0, "foot": 40.0}
        expected = [(f"{side}_{name}", gear) for side in ("right", "left") for name, gear in gears.items()]
        assert [(a.joint, a.gear) for a in walker.actuators] == expected
        assert {(a.law, a.ctrl_range) for a in walker.actuators} == {("effort", (-1.0, 1.0))}
        assert (walker.timestep, walker.substeps, walker.keepout) == (0.005, 10, 0.4)
        friction = {link.name: {part.friction for part in link.collisions} for link in walker.links if link.collisions}
        assert friction.pop("left_foot") == friction.pop("right_foot") == {2.0}
        assert all(values == {0.9} for values in friction.values())

    def test_observation_is_guards_in_its_order(self, walker: RobotModel) -> None:
        joints = [f"{side}_{name}" for side in ("left", "right") for name in ("foot", "hip_x", "hip_y", "hip_z", "leg")]
        names = [*IMU[:2], *(f"jointpos_{j}" for j in joints), *(f"jointvel_{j}" for j in joints), IMU[2]]
        names += ["touch_left_foot", "touch_right_foot", IMU[3]]
        assert sorted(sensor.name for sensor in walker.sensors) == names
        sizes = {"joint_position": 2, "joint_velocity": 1, "touch": 1}
        assert sum(sizes.get(sensor.kind, 3) for sensor in walker.sensors) == 44
        right = next(sensor for sensor in walker.sensors if sensor.name == "touch_right_foot")
        assert (right.link, right.radius) == ("right_foot", 0.05)

    def test_feet_just_touch_the_floor(self, walker: RobotModel) -> None:
        assert lowest(walker, "right_foot") == pytest.approx(0.0, abs=1e-15)
        assert lowest(walker, "left_foot") == pytest.approx(0.0, abs=1e-15)
