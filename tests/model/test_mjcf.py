"""What MJCF says besides the tree of bodies, how robot.toml completes it, and what is listed as left out."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from guard_api.model.robot import RobotModel
from guard_api.shapes import Box, Capsule, Pose, Sphere
from tests.model.mjcf_comparison import read

TEXT = """<mujoco model="jumper">
<option timestep="0.004"/>
<asset><material name="red" rgba="1 0 0 1"/></asset>
<worldbody>
<body name="torso" pos="0 0 0.7">
  <freejoint/>
  <geom name="belly" type="box" size="0.1 0.2 0.3" friction="0.4" material="red"/>
  <geom size="0.5" group="3" contype="0" conaffinity="0" mass="0"/>
  <geom type="capsule" size="0.1 0.2" contype="0" conaffinity="0" mass="0" rgba="0 1 0 0.5"/>
  <site name="imu" pos="0 0 0.1" euler="0 0 90"/>
  <body name="leg" pos="0 0 -0.3">
    <joint name="hip" axis="0 1 0" pos="0 0 0.05" ref="20" range="-30 40" armature="0.2" damping="1" stiffness="3"/>
    <geom name="shank" size="0.1"/>
    <site name="foot" pos="0 0 -0.1" size="0.07"/>
    <body name="toe" pos="0.1 0 0"><joint name="ball" type="ball"/><geom size="0.02"/></body>
  </body>
</body>
</worldbody>
<actuator>
  <motor name="first" joint="hip" gear="4" ctrlrange="-1 1"/>
  <motor name="second" site="imu" gear="3 0 4 0 0 0" ctrlrange="-2 2" forcerange="-0.5 0.5"/>
</actuator>
<sensor>
  <accelerometer name="accelerometer" site="imu"/>
  <gyro site="imu"/>
  <touch name="touch_foot" site="foot"/>
  <jointpos name="jointpos_hip" joint="hip"/>
  <jointvel name="jointvel_hip" joint="hip"/>
  <ballquat name="ballquat_toe" joint="ball"/>
  <ballangvel name="ballangvel_toe" joint="ball"/>
</sensor>
</mujoco>"""


@pytest.fixture
def jumper(tmp_path: Path) -> RobotModel:
    return read(tmp_path, TEXT)


def test_base_height_and_timestep_come_from_the_file(jumper: RobotModel) -> None:
    assert (jumper.name, jumper.base, jumper.root, jumper.home.height) == ("jumper", "floating", "torso", 0.7)
    assert jumper.timestep == 0.004


def test_a_body_keeps_its_name_where_its_frame_moves_to_its_joint(jumper: RobotModel) -> None:
    assert jumper.link_names[:2] == ("torso", "leg")
    leg = jumper.links[1]
    assert leg.com == pytest.approx((0.0, 0.0, -0.05))
    assert jumper.joints[0].child == "leg"
    assert jumper.joints[0].origin.position == pytest.approx((0.0, 0.0, -0.25))
    assert jumper.home.joint_position == {"hip": pytest.approx(math.radians(20.0))}


def test_shapes_touch_or_are_looked_at(jumper: RobotModel) -> None:
    torso = jumper.links[0]
    assert [type(part.shape) for part in torso.collisions] == [Box]
    assert torso.collisions[0].friction == 0.4
    assert [type(part.shape) for part in torso.visuals] == [Box, Capsule]  # group 3 is hidden
    assert [part.rgba for part in torso.visuals] == [(1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.5)]
    assert [type(part.shape) for part in jumper.links[1].collisions] == [Sphere]
    assert jumper.links[1].collisions[0].friction == 1.0


def test_sensors_have_the_kinds_and_places_of_the_neutral_model(jumper: RobotModel) -> None:
    sensors = {sensor.name: sensor for sensor in jumper.sensors}
    assert [(s.name, s.kind) for s in jumper.sensors[:3]] == [
        ("accelerometer", "accelerometer"),
        ("gyro_imu", "gyro"),
        ("touch_foot", "touch"),
    ]
    assert sensors["accelerometer"].link == "torso"
    np.testing.assert_allclose(sensors["accelerometer"].pose.quaternion, [0.5**0.5, 0, 0, 0.5**0.5])
    foot = sensors["touch_foot"]
    assert (foot.link, foot.radius) == ("leg", 0.07)
    assert foot.pose.position == pytest.approx((0.0, 0.0, -0.15))
    assert (sensors["jointpos_hip"].joint, sensors["jointvel_hip"].kind) == ("hip", "joint_velocity")
    assert (sensors["ballquat_toe"].kind, sensors["ballquat_toe"].link) == ("relative_rotation", "toe")
    assert sensors["ballangvel_toe"].kind == "relative_angular_velocity"


def test_a_motor_on_a_site_is_a_thrust(jumper: RobotModel) -> None:
    thrust = jumper.actuators[1]
    assert (thrust.law, thrust.link, thrust.gear, thrust.effort_limit) == ("thrust", "torso", 5.0, 2.5)
    np.testing.assert_allclose(thrust.direction, [0.0, 0.6, 0.8], atol=1e-15)  # the site is turned by 90 degrees
    assert (thrust.point, thrust.ctrl_range) == ((0.0, 0.0, 0.1), (-2.0, 2.0))


def test_robot_toml_overrides_by_name_and_adds(tmp_path: Path) -> None:
    toml = """
        timestep = 0.002
        licence = "CC0-1.0"
        reference = "leg"
        armature = { hip = 0.9 }
        friction = { belly = 0.8, shank = 0.3 }
        home = { height = 2.0, joints = { hip = 0.1 } }
        [[actuators]]
        name = "third"
        law = "effort"
        joint = "hip"
        [[actuators]]
        name = "first"
        law = "position"
        joint = "hip"
        kp = 3.0
        [[sensors]]
        name = "gyro_imu"
        kind = "gyro"
        link = "leg"
    """
    model = read(tmp_path, TEXT, toml)
    assert (model.timestep, model.licence, model.home.height) == (0.002, "CC0-1.0", 2.0)
    assert model.home.joint_position == {"hip": 0.1}
    hip = model.joints[0]
    assert (hip.armature, hip.damping, hip.stiffness) == (0.9, 1.0, 3.0)
    assert [(a.name, a.law) for a in model.actuators] == [
        ("first", "position"),
        ("second", "thrust"),
        ("third", "effort"),
    ]
    assert [link.collisions[0].friction for link in model.links[:2]] == [0.8, 0.3]
    assert [s.link for s in model.sensors[:2]] == ["torso", "leg"]
    # A link's name stands for the body's frame of the file, wherever the model has put the link's own.
    assert model.reference is not None
    assert model.reference.pose.position == pytest.approx((0.0, 0.0, -0.05))
    assert model.sensors[1].pose.position == pytest.approx((0.0, 0.0, -0.05))


def test_the_default_of_a_side_file_is_not_a_statement(tmp_path: Path) -> None:
    assert read(tmp_path, TEXT, "timestep = 0.002").timestep == 0.002
    assert read(tmp_path, TEXT, "keepout = 0.3").timestep == 0.004


PLANAR = """<mujoco><worldbody><body name="b" pos="0 0 0.3">
<joint name="x" type="slide" axis="1 0 0" damping="1"/><joint name="y" type="slide" axis="0 1 0" damping="2"/>
<joint name="yaw" damping="3" armature="4"/><geom size="0.1"/></body></worldbody>
<actuator><motor name="turn" joint="yaw" ctrlrange="-1 1"/></actuator>
<sensor><jointvel name="rate" joint="yaw"/></sensor></mujoco>"""


def test_a_planar_base_takes_the_dynamics_of_the_joints_written_for_it(tmp_path: Path) -> None:
    model = read(tmp_path, PLANAR, 'base = { kind = "planar", armature = [5, 6, 7] }')
    assert model.joint_names == ("base_x", "base_y", "base_yaw")
    assert [joint.damping for joint in model.joints] == [1.0, 2.0, 3.0]
    assert [joint.armature for joint in model.joints] == [5.0, 6.0, 7.0]
    assert (model.actuators[0].joint, model.sensors[0].joint) == ("base_yaw", "base_yaw")
    assert (model.home.height, model.root) == (0.3, "b")


def test_the_same_file_without_a_planar_base_is_fixed_with_three_joints(tmp_path: Path) -> None:
    model = read(tmp_path, PLANAR)
    assert (model.base, model.root, model.home.height) == ("fixed", "world", 0.3)
    assert model.joint_names == ("x", "y", "yaw")
    assert model.link_names == ("world", "x", "y", "b")


def test_a_body_without_joints_floats_or_slides_if_the_side_file_says_so(tmp_path: Path) -> None:
    text = '<mujoco><worldbody><body name="b" pos="0 0 0.3"><geom size="0.1"/></body></worldbody></mujoco>'
    assert read(tmp_path, text).base == "fixed"
    for kind in ("planar", "floating"):
        model = read(tmp_path, text, f'base.kind = "{kind}"')
        assert (model.base, model.root, model.home.height) == (kind, "b", 0.3)


def test_a_tilted_fixed_body_keeps_its_name(tmp_path: Path) -> None:
    text = (
        '<mujoco><worldbody><body name="b" pos="1 0 0.3" euler="90 0 0"><geom size="0.1"/></body></worldbody></mujoco>'
    )
    model = read(tmp_path, text)
    assert (model.root, model.home.height) == ("b", 0.3)
    assert model.links[0].collisions[0].pose.position == (1.0, 0.0, 0.0)


def test_what_is_left_out_is_listed_once_per_kind_by_line(tmp_path: Path) -> None:
    text = """<mujoco>
<option gravity="0 0 0" cone="elliptic"/>
<worldbody><light/><geom type="plane" size="1 1 1"/>
<body><freejoint/>
<geom size="0.1" condim="6" margin="0.01" friction="1 0.1 0.1"/>
<geom size="0.1" condim="4" contype="2" friction="1 0.1 0.1"/>
<body name="leg"><joint name="j" margin="1"/><geom size="0.1" solref="0.1 1"/><camera/></body>
</body></worldbody>
<tendon><fixed><joint joint="j" coef="1"/></fixed></tendon>
<equality><joint joint1="j" active="false"/></equality>
<contact><exclude body1="a" body2="b"/><exclude body1="c" body2="d"/></contact>
<sensor><framepos objtype="body" objname="leg"/></sensor>
<keyframe><key/></keyframe>
</mujoco>"""
    notes = [note for note in read(tmp_path, text).notes if note.startswith("r.xml")]
    assert sorted(notes) == sorted(
        [
            "r.xml: attribute gravity of <option> is ignored (at line 2)",
            "r.xml: attribute cone of <option> is ignored (at line 2)",
            "r.xml: <light> in <worldbody> is ignored (at line 3)",
            "r.xml: <geom> in <worldbody> is ignored (at line 3)",
            "r.xml: attribute condim of <geom> is ignored (2 times, first at line 5)",
            "r.xml: attribute margin of <geom> is ignored (at line 5)",
            "r.xml: attribute margin of <joint> is ignored (at line 7)",
            "r.xml: attribute solref of <geom> is ignored (at line 7)",
            "r.xml: <camera> in <body> is ignored (at line 7)",
            "r.xml: <fixed> in <tendon> is ignored (at line 9)",
            "r.xml: <joint> in <equality> is ignored (at line 10)",
            "r.xml: <exclude> in <contact> is ignored (2 times, first at line 11)",
            "r.xml: <framepos> in <sensor> is ignored (at line 12)",
            "r.xml: <key> in <keyframe> is ignored (at line 13)",
            "r.xml: torsional and rolling friction are ignored (2 times, first at line 5)",
            "r.xml: a geom touches everything, whatever contype and conaffinity other than 0, 0 say (at line 6)",
            "r.xml:4: the <body> without a name is called 'body'",
        ]
    )


def test_a_file_that_is_understood_whole_has_no_notes(tmp_path: Path) -> None:
    text = TEXT.replace("<gyro site", '<gyro name="gyro" site')
    notes = read(tmp_path, text).notes
    assert all("ball" in note for note in notes), notes


def test_pose_of_a_site_between_two_points(tmp_path: Path) -> None:
    text = TEXT.replace('<site name="imu" pos="0 0 0.1" euler="0 0 90"/>', '<site name="imu" fromto="0 0 1 0 0 0"/>')
    assert read(tmp_path, text).sensors[0].pose == Pose(position=(0.0, 0.0, 0.5))
