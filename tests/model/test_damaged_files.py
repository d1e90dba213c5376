"""Whatever happens to a file, it is read as a sound robot or refused with a ModelError: nothing else."""

from __future__ import annotations

import math
import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from guard_api.errors import ModelError
from guard_api.model.library import load_robot_file
from guard_api.model.robot import RobotModel

URDF = """<?xml version="1.0"?>
<robot name="r">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="world"/>
  <joint name="free" type="floating"><parent link="world"/><child link="a"/><origin xyz="0 0 1"/></joint>
  <link name="a">
    <inertial><origin xyz="0 0 0.1" rpy="0.1 0 0"/><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry><material name="red"/></visual>
    <collision name="c"><origin xyz="1 0 0"/><geometry><capsule radius="0.1" length="1"/></geometry></collision>
  </link>
  <link name="b"><collision><geometry><cylinder radius="0.1" length="1"/></geometry></collision></link>
  <link name="c"><collision><geometry><mesh filename="tetra.obj" scale="1 1 1"/></geometry></collision></link>
  <joint name="hinge" type="revolute">
    <parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="1 2 3"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="3" velocity="4"/><dynamics damping="0.1" friction="0.2"/>
  </joint>
  <link name="d"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="shoulder" type="ball"><parent link="a"/><child link="d"/><dynamics damping="0.1"/></joint>
  <joint name="weld" type="fixed"><parent link="b"/><child link="c"/><origin quat_xyzw="0 0 0 1"/></joint>
</robot>
"""
TOML = """
licence = "CC0-1.0"
density = 100.0
substeps = 4
reference = "c"
lidar = ["c", "a"]
friction = { default = 0.5, c = 2.0 }
armature = { hinge = 0.1, shoulder = 0.2 }
damping = { shoulder_x = 0.3 }
stiffness = { default = 1.0 }
rest_position = { hinge = 0.1 }
base.kind = "floating"
home = { height = 1.0, joints = { hinge = 0.2 } }
[[actuators]]
name = "hinge"
law = "position"
joint = "hinge"
kp = 2.0
ctrl_range = [-2, 2]
[[actuators]]
name = "jet"
law = "thrust"
link = "c"
direction = [0, 0, 1]
offset = 2.0
ceiling = 3.0
[[sensors]]
kind = "gyro"
link = "c"
rpy = [0, 1, 0]
[[sensors]]
kind = "touch"
link = "c"
radius = 0.1
[[sensors]]
kind = "joint_position"
joint = "shoulder_y"
[[sensors]]
kind = "relative_rotation"
link = "d"
[[segments]]
start = "a"
end = "c"
radius = 0.1
"""
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
NASTY = [
    *("nan", "-inf", "1e999", "1e308", "1e30", "-1e30", "1e-320", "1e-12", "0", "-1", "1,5", "1 2", "0 0 0", "1 1 1"),
    *("", " ", "é", "☃", "../x", "world", "a", "b", "c", "hinge", "weld", "fixed", "planar", "floating", "prismatic"),
]
many = settings(suppress_health_check=[HealthCheck.too_slow])


def read(urdf: bytes, toml: bytes) -> RobotModel | None:
    """The robot, or None if it is refused."""
    with TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "r.urdf").write_bytes(urdf)
        (place / "robot.toml").write_bytes(toml)
        (place / "tetra.obj").write_text(TETRAHEDRON)
        try:
            return load_robot_file(place / "r.urdf")
        except ModelError as error:
            assert all(re.match(r".*(r\.urdf|robot\.toml)(:| )", line) for line in str(error).splitlines()), error
            return None


def assert_sound(value: object) -> None:
    """Finite wherever a number is no limit, and a tree in order."""
    if isinstance(value, RobotModel):
        known = {value.links[0].name}
        for joint, link in zip(value.joints, value.links[1:], strict=True):
            assert joint.child == link.name
            assert joint.parent in known
            assert abs(math.hypot(*joint.axis) - 1.0) < 1e-12
            known.add(link.name)
        frames = [*value.lidar, *(end for item in value.segments for end in (item.start, item.end))]
        assert {item.link for item in (*value.sensors, *frames) if item.link} <= known
        assert {item.joint for item in value.sensors if item.joint} <= set(value.joint_names)
    if is_dataclass(value):
        for field in fields(value):
            if not field.name.endswith("_limit") and field.name not in {"ceiling", "radius", "reach"}:
                assert_sound(getattr(value, field.name))
    elif isinstance(value, tuple):
        for item in value:
            assert_sound(item)
    elif isinstance(value, float):
        assert math.isfinite(value)


def test_the_undamaged_files_are_read() -> None:
    assert_sound(read(URDF.encode(), TOML.encode()))


@many
@given(st.data())
def test_replaced_values(data: st.DataObject) -> None:
    text = URDF
    for _ in range(data.draw(st.integers(1, 3))):
        start, end = data.draw(st.sampled_from([match.span(1) for match in re.finditer(r'="([^"]*)"', text)]))
        text = text[:start] + data.draw(st.sampled_from(NASTY)) + text[end:]
    assert_sound(read(text.encode(), TOML.encode()))


@many
@given(st.data())
def test_removed_doubled_moved_and_renamed_elements(data: st.DataObject) -> None:
    root = etree.fromstring(URDF.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        elements = list(root.iterdescendants())
        if not elements:
            break
        element, other = data.draw(st.sampled_from(elements)), data.draw(st.sampled_from([root, *elements]))
        match data.draw(st.sampled_from(["remove", "double", "move", "rename", "strip"])):
            case "remove":
                element.getparent().remove(element)
            case "double":
                element.addnext(etree.fromstring(etree.tostring(element, with_tail=False)))
            case "move" if other not in element.iter():
                other.append(element)
            case "rename":
                element.tag = other.tag
            case _:
                element.attrib.clear()
    assert_sound(read(etree.tostring(root), TOML.encode()))


@many
@given(st.data())
def test_damaged_bytes(data: st.DataObject) -> None:
    urdf, toml = (bytearray(text.encode()) for text in (URDF, TOML))
    for target in (urdf, toml):
        for _ in range(data.draw(st.integers(0, 3))):
            start = data.draw(st.integers(0, len(target)))
            target[start : start + data.draw(st.integers(0, 12))] = data.draw(st.binary(max_size=4))
    assert_sound(read(bytes(urdf), bytes(toml)))


@many
@given(st.data())
def test_replaced_values_of_the_side_file(data: st.DataObject) -> None:
    values = [
        "nan",
        "-1",
        "0",
        "true",
        '""',
        '"x"',
        '"a"',
        "[]",
        "[1, 2, 3]",
        "{}",
        "1e300",
        "9" * 400,
        '"default"',
        "[{}]",
    ]
    start, end = data.draw(st.sampled_from([match.span(1) for match in re.finditer(r"= ([^\n{}\[\]]+)\n", TOML)]))
    text = TOML[:start] + data.draw(st.sampled_from(values)) + TOML[end:]
    assert_sound(read(URDF.encode(), text.encode()))


def test_entities_are_not_expanded_and_files_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("secret")
    text = f'<!DOCTYPE robot [<!ENTITY x SYSTEM "file://{secret}">]><robot name="r">&x;<link name="a"/></robot>'
    model = read(text.encode(), b'base.kind = "fixed"')
    assert model is not None
    assert "secret" not in repr(model)
