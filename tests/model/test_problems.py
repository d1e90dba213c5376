"""One golden case per kind of problem of a URDF: what is wrong, and the line where it stands."""

from __future__ import annotations

from pathlib import Path

import pytest

from guard_api.errors import ModelError
from guard_api.model.library import load_robot_file
from tests.model.files import ENDS, ONE, A, B, complaint, hinge, robot

BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'


def a(content: str) -> str:
    return f'<link name="a">{content}</link>'


def inertial(mass: str = "1", moments: tuple[str, str, str] = ("1", "1", "1")) -> str:
    xx, yy, zz = moments
    return a(f'<inertial><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}"/></inertial>')


XML = {
    "malformed": ("<robot name='r'>\n<link name='a'>\n</robot>", "r.urdf:3: malformed XML"),
    "empty file": ("", "malformed XML"),
    "not a robot": ("<mujoco/>", "r.urdf:1: the outermost element is <mujoco>"),
    "no links": (robot(), "r.urdf:1: <robot> has no <link>"),
    "xacro": (
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:macro name="m"/></robot>',
        "r.urdf:2: xacro macros are not URDF",
    ),
    "misspelt element": (robot("<lnik name='a'/>", A), "r.urdf:2: unknown 'lnik' in <URDF>: did you mean 'link'?"),
    "misspelt attribute": (
        robot(A, B, hinge(rest='\n<dynamics dampng="1"/>')),
        "r.urdf:5: unknown attribute 'dampng' in <dynamics>: did you mean 'damping'?",
    ),
    "no name": (robot(f"<link>{ONE}</link>"), "r.urdf:2: <link> has no name"),
    "two inertials": (robot(a(f"{ONE}\n{ONE}")), "r.urdf:3: <link> has more than one <inertial>"),
    "no mass": (
        robot(a('<inertial><inertia ixx="1" iyy="1" izz="1"/></inertial>')),
        "r.urdf:2: <inertial> has no <mass>",
    ),
    "no inertia": (robot(a('<inertial><mass value="1"/></inertial>')), "r.urdf:2: <inertial> has no <inertia>"),
    "zero mass": (robot(inertial("0")), "r.urdf:2: link 'a': mass 0 kg must be positive"),
    "negative mass": (robot(inertial("-2")), "r.urdf:2: link 'a': mass -2 kg must be positive"),
    "indefinite inertia": (robot(inertial(moments=("1", "-1", "1"))), "r.urdf:2: link 'a': no rigid body has this"),
    "triangle": (
        robot(inertial(moments=("1", "1", "3"))),
        "its largest principal moment 3 exceeds the sum of the others, 2",
    ),
    "nan": (robot(inertial("nan")), "r.urdf:2: <mass> value: 'nan' is not a finite number"),
    "inf": (robot(inertial("-inf")), "r.urdf:2: <mass> value: '-inf' is not a finite number"),
    "overflow": (robot(inertial("1e999")), "'1e999' is not a finite number"),
    "no number": (robot(inertial("heavy")), "r.urdf:2: <mass> value: 'heavy' is not a finite number"),
    "decimal comma": (robot(inertial("1,5")), "'1,5' is not a finite number"),
    "underscore": (robot(inertial("1_000")), "'1_000' is not a finite number"),
    "too few numbers": (
        robot(a(f'{ONE}<collision><origin xyz="1 2"/><geometry><sphere radius="1"/></geometry></collision>')),
        """r.urdf:2: <origin> xyz='1 2' has 2 numbers instead of 3""",
    ),
    "no radius": (
        robot(a(f"{ONE}<collision><geometry>\n<sphere/></geometry></collision>")),
        "r.urdf:3: <sphere> has no radius",
    ),
    "negative radius": (
        robot(a(f'{ONE}<collision><geometry><sphere radius="-1"/></geometry></collision>')),
        "r.urdf:2: <sphere> radius -1 must be positive",
    ),
    "no geometry": (robot(a(f"{ONE}<collision/>")), "r.urdf:2: <collision> has no <geometry>"),
    "two shapes": (
        robot(a(f'{ONE}<collision><geometry><sphere radius="1"/><sphere radius="1"/></geometry></collision>')),
        "<geometry> holds 2 shapes",
    ),
    "unsupported shape": (
        robot(a(f"{ONE}<collision><geometry><plane/></geometry></collision>")),
        "r.urdf:2: <plane> is no collision shape here",
    ),
    "missing mesh": (
        robot(a(f'{ONE}<collision><geometry><mesh filename="package://p/no.stl"/></geometry></collision>')),
        "r.urdf:2: mesh file 'package://p/no.stl' does not exist",
    ),
    "duplicate link": (robot(A, A), "r.urdf:3: link name 'a' is taken already (r.urdf:2): rename one"),
    "duplicate joint": (
        robot(A, B, hinge(), '<link name="c"/>', hinge(ends='<parent link="b"/><child link="c"/>')),
        "r.urdf:6: joint name 'j' is taken already (r.urdf:4): rename one",
    ),
    "two roots": (robot(A, B), "r.urdf:3: link 'b' hangs on no joint, and neither does 'a'"),
    "missing parent": (
        robot(A, hinge(ends='<parent link="x"/><child link="a"/>')),
        "r.urdf:3: joint 'j': its parent link 'x' does not exist",
    ),
    "missing child": (
        robot(A, hinge(ends='<parent link="a"/><child link="x"/>')),
        "r.urdf:3: joint 'j': its child link 'x' does not exist",
    ),
    "no parent": (robot(A, B, hinge(ends='<child link="b"/>')), "r.urdf:4: <joint> has no <parent>"),
    "closed chain": (
        robot(A, B, hinge(), f'<joint name="k" type="fixed">{ENDS}</joint>'),
        "r.urdf:5: link 'b' is the child of joints 'j' and 'k'",
    ),
    "loop": (
        robot(A, B, hinge(), hinge(ends='<parent link="b"/><child link="a"/>').replace('"j"', '"k"')),
        "joints form a loop: ",
    ),
    "own parent": (robot(A, B, hinge(ends='<parent link="b"/><child link="b"/>')), "r.urdf:4: joints form a loop: j"),
    "unknown joint type": (
        robot(A, B, hinge("revolut")),
        "r.urdf:4: joint 'j' has the unknown type 'revolut': did you mean 'revolute'?",
    ),
    "floating in mid-tree": (robot(A, B, hinge("floating")), "r.urdf:4: joint 'j' is floating: only the first joint"),
    "no limits": (robot(A, B, hinge("revolute")), "r.urdf:4: revolute joint 'j' has no position limits"),
    "slide without limits": (
        robot(A, B, hinge("prismatic", rest='<limit effort="1" velocity="1"/>')),
        "prismatic joint 'j' has no position limits",
    ),
    "limits reversed": (
        robot(A, B, hinge("revolute", rest='\n<limit lower="1" upper="-1"/>')),
        "r.urdf:5: joint 'j': lower limit 1 is not below upper limit -1: exchange them",
    ),
    "locked": (
        robot(A, B, hinge("revolute", rest='<limit lower="1" upper="1"/>')),
        "lower limit 1 is not below upper limit 1: make it fixed",
    ),
    "negative effort": (robot(A, B, hinge(rest='<limit effort="-1"/>')), "effort limit -1 must not be negative"),
    "zero axis": (
        robot(A, B, hinge().replace("0 0 1", "0 0 0")),
        "r.urdf:4: joint 'j': the axis is zero",
    ),
    "mimic": (
        robot(A, B, hinge(rest='<mimic joint="j"/>')),
        "r.urdf:4: joint 'j': <mimic> is not supported: remove it and drive the joint by an actuator of its own",
    ),
    "negative damping": (robot(A, B, hinge(rest='<dynamics damping="-1"/>')), "must not be negative"),
    "no inertial, no shapes": (
        robot(A, '<link name="b"/>', hinge()),
        "r.urdf:3: link 'b' moves but has neither <inertial> nor collision shapes",
    ),
    "no inertial, no density": (
        robot(A, f'<link name="b">{BALL}</link>', hinge()),
        "r.urdf:3: link 'b' moves but has no <inertial>: add one, or state density",
    ),
    "point mass alone": (
        robot(A, B.replace('ixx="1" iyy="1" izz="1"', 'ixx="0" iyy="0" izz="0"'), hinge()),
        "r.urdf:3: link 'b' moves, but its inertia is zero",
    ),
}


@pytest.mark.parametrize("case", XML)
def test_a_faulty_urdf(case: str, tmp_path: Path) -> None:
    urdf, expected = XML[case]
    lines = complaint(tmp_path, urdf)
    assert any(expected in line for line in lines), lines
    assert all(line.startswith("r.urdf") for line in lines)


@pytest.mark.parametrize("faulty", ['mass="-0.2" i="1"', 'mass="1" i="-1"'])
def test_a_refused_inertial_is_one_problem(faulty: str, tmp_path: Path) -> None:
    mass, moment = (word.split("=")[1].strip('"') for word in faulty.split())
    body = inertial(mass, (moment, "1", "1")).replace("</link>", f"{BALL}</link>").replace('"a"', '"b"')
    (line,) = complaint(tmp_path, robot(A, body, hinge()))
    assert line.startswith("r.urdf:3: link 'b': ")


def test_meshes_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "rubbish.stl").write_bytes(b"\x00\x01rubbish")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for name in ("rubbish.stl", "flat.obj"):
        shape = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        (line,) = complaint(tmp_path, robot(a(f"{ONE}{shape}")))
        assert line.startswith(f"r.urdf:2: mesh file '{name}' cannot be used (")


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"nowhere\.urdf: cannot be read"):
        load_robot_file(tmp_path / "nowhere.urdf")
    (tmp_path / "r.urdf").write_text(robot(A))
    with pytest.raises(ModelError, match=r"nowhere\.toml: cannot be read"):
        load_robot_file(tmp_path / "r.urdf", tmp_path / "nowhere.toml")
