"""What the keys of a side file mean in the model."""

from __future__ import annotations

import math
from pathlib import Path

from guard_api.model.robot import Frame, RobotModel, Segment
from guard_api.shapes import Pose
from tests.model.files import Z, joint, link, load


def leg(folder: Path, toml: str) -> RobotModel:
    """A trunk, thigh and foot on the hinges hip and knee, with a tip fixed to the foot."""
    return load(
        folder,
        link("trunk"),
        link("thigh"),
        link("foot"),
        '<link name="tip"/>',
        joint("hip", "continuous", "trunk", "thigh", f'{Z}<dynamics damping="0.5"/>'),
        joint("knee", "continuous", "thigh", "foot", f'{Z}<dynamics damping="0.25"/>'),
        joint("toe", "fixed", "foot", "tip", xyz="1 0 0"),
        toml=toml,
    )


def test_nothing_passive_without_keys(tmp_path: Path) -> None:
    model = leg(tmp_path, "base.kind = 'floating'")
    passive = [(item.damping, item.stiffness, item.rest_position, item.armature) for item in model.joints]
    assert passive == [(0.5, 0.0, 0.0, 0.0), (0.25, 0.0, 0.0, 0.0)]
    assert (model.reference, model.lidar, model.segments, model.sensors) == (None, (), (), ())


def test_passive_forces_by_joint_and_by_default(tmp_path: Path) -> None:
    toml = """
    damping = { knee = 0.0 }
    stiffness = { default = 2.0, knee = 3.0 }
    rest_position = { default = -0.5, hip = 0.5 }
    """
    model = leg(tmp_path, toml)
    passive = [(item.damping, item.stiffness, item.rest_position) for item in model.joints]
    assert passive == [(0.5, 2.0, 0.5), (0.0, 3.0, -0.5)]
    assert [item.damping for item in leg(tmp_path, "damping.default = 4").joints] == [4.0, 4.0]


def test_thrust_that_hovers_below_a_ceiling(tmp_path: Path) -> None:
    rotor = '[[actuators]]\nname = "{}"\nlaw = "thrust"\nlink = "foot"\ndirection = [0, 0, 1]\n'
    toml = f"{rotor.format('plain')}{rotor.format('hover')}offset = 2.5\nceiling = 3\n"
    plain, hover = leg(tmp_path, toml).actuators
    assert (plain.offset, plain.ceiling) == (0.0, math.inf)
    assert (hover.offset, hover.ceiling) == (2.5, 3.0)


def test_default_names_of_sensors(tmp_path: Path) -> None:
    on_links = ("gyro", "touch", "relative_rotation", "relative_angular_velocity")
    places = [(kind, "link", "foot") for kind in on_links]
    places += [("joint_position", "joint", "hip"), ("joint_velocity", "joint", "base_yaw")]
    toml = "base.kind = 'planar'\n" + "\n".join(
        f"[[sensors]]\nkind = '{kind}'\n{key} = '{name}'" for kind, key, name in places
    )
    sensors = leg(tmp_path, toml).sensors
    assert [sensor.name for sensor in sensors] == [
        "gyro", "touch_foot", "ballquat_foot", "ballangvel_foot", "jointpos_hip", "jointvel_base_yaw",
    ]  # fmt: skip
    assert [(sensor.link, sensor.joint) for sensor in sensors[3:]] == [
        ("foot", None), (None, "hip"), (None, "base_yaw"),
    ]  # fmt: skip


def test_touch_at_several_places_of_a_body(tmp_path: Path) -> None:
    touch = '[[sensors]]\nkind = "touch"\nlink = "{}"\nname = "{}"\n{}\n'
    places = [
        ("foot", "all", ""),
        ("foot", "heel", "position = [0, 0, 1]\nradius = 0.1"),
        ("thigh", "thigh", ""),
        ("tip", "toe", "position = [0, 2, 0]\nradius = 0.2"),
    ]
    model = leg(tmp_path, "".join(touch.format(*place) for place in places))
    assert model.touch_sensors == model.sensors
    assert [(item.name, item.link, item.pose.position, item.radius) for item in model.sensors] == [
        ("all", "foot", (0.0, 0.0, 0.0), math.inf),
        ("heel", "foot", (0.0, 0.0, 1.0), 0.1),
        ("thigh", "thigh", (0.0, 0.0, 0.0), math.inf),
        ("toe", "foot", (1.0, 2.0, 0.0), 0.2),
    ]


def test_named_places(tmp_path: Path) -> None:
    toml = """
    reference = "tip"
    lidar = ["tip", "thigh"]
    [[segments]]
    start = "thigh"
    end = "foot"
    [[segments]]
    start = "foot"
    end = "tip"
    radius = 0.25
    """
    model = leg(tmp_path, toml)
    thigh, foot = (Frame(name=name, link=name) for name in ("thigh", "foot"))
    tip = Frame(name="tip", link="foot", pose=Pose(position=(1.0, 0.0, 0.0)))
    assert model.reference == tip
    assert model.lidar == (tip, thigh)
    assert model.segments == (Segment(start=thigh, end=foot), Segment(start=foot, end=tip, radius=0.25))
