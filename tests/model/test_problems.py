"""One golden case per kind of problem: what is wrong, and the line or key where it stands."""

from __future__ import annotations

from pathlib import Path

import pytest

from guard_api.errors import ModelError
from guard_api.model.library import load_robot_file

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
A, B = (f'<link name="{name}">{INERTIAL}</link>' for name in "ab")
HINGE = '<joint name="j" type="{type}">{ends}<axis xyz="0 0 1"/>{rest}</joint>'
ENDS = '<parent link="a"/><child link="b"/>'
LIMIT = '<limit lower="-1" upper="1"/>'


def robot(*lines: str) -> str:
    """A robot whose n-th line, counted from 1 for <robot>, is lines[n - 2]."""
    return "\n".join(['<robot name="r">', *lines, "</robot>"])


def joint(type_: str = "continuous", *, ends: str = ENDS, rest: str = "") -> str:
    return HINGE.format(type=type_, ends=ends, rest=rest)


def link(content: str) -> str:
    return f'<link name="a">{content}</link>'


def inertial(mass: str = "1", moments: tuple[str, str, str] = ("1", "1", "1")) -> str:
    xx, yy, zz = moments
    return link(f'<inertial><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}"/></inertial>')


def complaint(tmp_path: Path, urdf: str, toml: str | None = None) -> list[str]:
    """The lines of the error, without the folder."""
    (tmp_path / "r.urdf").write_text(urdf)
    if toml is not None:
        (tmp_path / "robot.toml").write_text(toml)
    with pytest.raises(ModelError) as caught:
        load_robot_file(tmp_path / "r.urdf")
    return str(caught.value).replace(f"{tmp_path}/", "").splitlines()


FLOATING = '[base]\nkind = "floating"'

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
        robot(A, B, joint(rest='\n<dynamics dampng="1"/>')),
        "r.urdf:5: unknown attribute 'dampng' in <dynamics>: did you mean 'damping'?",
    ),
    "no name": (robot(f"<link>{INERTIAL}</link>"), "r.urdf:2: <link> has no name"),
    "two inertials": (robot(link(f"{INERTIAL}\n{INERTIAL}")), "r.urdf:3: <link> has more than one <inertial>"),
    "no mass": (
        robot(link('<inertial><inertia ixx="1" iyy="1" izz="1"/></inertial>')),
        "r.urdf:2: <inertial> has no <mass>",
    ),
    "no inertia": (robot(link('<inertial><mass value="1"/></inertial>')), "r.urdf:2: <inertial> has no <inertia>"),
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
        robot(link(f'{INERTIAL}<collision><origin xyz="1 2"/><geometry><sphere radius="1"/></geometry></collision>')),
        """r.urdf:2: <origin> xyz='1 2' has 2 numbers instead of 3""",
    ),
    "no radius": (
        robot(link(f"{INERTIAL}<collision><geometry>\n<sphere/></geometry></collision>")),
        "r.urdf:3: <sphere> has no radius",
    ),
    "negative radius": (
        robot(link(f'{INERTIAL}<collision><geometry><sphere radius="-1"/></geometry></collision>')),
        "r.urdf:2: <sphere> radius -1 must be positive",
    ),
    "no geometry": (robot(link(f"{INERTIAL}<collision/>")), "r.urdf:2: <collision> has no <geometry>"),
    "two shapes": (
        robot(link(f'{INERTIAL}<collision><geometry><sphere radius="1"/><sphere radius="1"/></geometry></collision>')),
        "<geometry> holds 2 shapes",
    ),
    "unsupported shape": (
        robot(link(f"{INERTIAL}<collision><geometry><plane/></geometry></collision>")),
        "r.urdf:2: <plane> is no collision shape here",
    ),
    "missing mesh": (
        robot(link(f'{INERTIAL}<collision><geometry><mesh filename="package://p/no.stl"/></geometry></collision>')),
        "r.urdf:2: mesh file 'package://p/no.stl' does not exist",
    ),
    "duplicate link": (robot(A, A), "r.urdf:3: link name 'a' is taken already (r.urdf:2): rename one"),
    "duplicate joint": (
        robot(A, B, joint(), '<link name="c"/>', joint(ends='<parent link="b"/><child link="c"/>')),
        "r.urdf:6: joint name 'j' is taken already (r.urdf:4): rename one",
    ),
    "two roots": (robot(A, B), "r.urdf:3: link 'b' hangs on no joint, and neither does 'a'"),
    "missing parent": (
        robot(A, joint(ends='<parent link="x"/><child link="a"/>')),
        "r.urdf:3: joint 'j': its parent link 'x' does not exist",
    ),
    "missing child": (
        robot(A, joint(ends='<parent link="a"/><child link="x"/>')),
        "r.urdf:3: joint 'j': its child link 'x' does not exist",
    ),
    "no parent": (robot(A, B, joint(ends='<child link="b"/>')), "r.urdf:4: <joint> has no <parent>"),
    "closed chain": (
        robot(A, B, joint(), f'<joint name="k" type="fixed">{ENDS}</joint>'),
        "r.urdf:5: link 'b' is the child of joints 'j' and 'k'",
    ),
    "loop": (
        robot(A, B, joint(), joint(ends='<parent link="b"/><child link="a"/>').replace('"j"', '"k"')),
        "joints form a loop: ",
    ),
    "own parent": (robot(A, B, joint(ends='<parent link="b"/><child link="b"/>')), "r.urdf:4: joints form a loop: j"),
    "unknown joint type": (
        robot(A, B, joint("revolut")),
        "r.urdf:4: joint 'j' has the unknown type 'revolut': did you mean 'revolute'?",
    ),
    "floating in mid-tree": (robot(A, B, joint("floating")), "r.urdf:4: joint 'j' is floating: only the first joint"),
    "no limits": (robot(A, B, joint("revolute")), "r.urdf:4: revolute joint 'j' has no position limits"),
    "slide without limits": (
        robot(A, B, joint("prismatic", rest='<limit effort="1" velocity="1"/>')),
        "prismatic joint 'j' has no position limits",
    ),
    "limits reversed": (
        robot(A, B, joint("revolute", rest='\n<limit lower="1" upper="-1"/>')),
        "r.urdf:5: joint 'j': lower limit 1 is not below upper limit -1: exchange them",
    ),
    "locked": (
        robot(A, B, joint("revolute", rest='<limit lower="1" upper="1"/>')),
        "lower limit 1 is not below upper limit 1: make it fixed",
    ),
    "negative effort": (robot(A, B, joint(rest='<limit effort="-1"/>')), "effort limit -1 must not be negative"),
    "zero axis": (
        robot(A, B, joint().replace("0 0 1", "0 0 0")),
        "r.urdf:4: joint 'j': the axis is zero",
    ),
    "mimic": (
        robot(A, B, joint(rest='<mimic joint="j"/>')),
        "r.urdf:4: joint 'j': <mimic> is not supported: remove it and drive the joint by an actuator of its own",
    ),
    "negative damping": (robot(A, B, joint(rest='<dynamics damping="-1"/>')), "must not be negative"),
    "no inertial, no shapes": (
        robot(A, '<link name="b"/>', joint()),
        "r.urdf:3: link 'b' moves but has neither <inertial> nor collision shapes",
    ),
    "no inertial, no density": (
        robot(A, f'<link name="b">{BALL}</link>', joint()),
        "r.urdf:3: link 'b' moves but has no <inertial>: add one, or state density",
    ),
    "point mass alone": (
        robot(A, B.replace('ixx="1" iyy="1" izz="1"', 'ixx="0" iyy="0" izz="0"'), joint()),
        "r.urdf:3: link 'b' moves, but its inertia is zero",
    ),
}


@pytest.mark.parametrize("case", XML)
def test_a_faulty_urdf(case: str, tmp_path: Path) -> None:
    urdf, expected = XML[case]
    lines = complaint(tmp_path, urdf)
    assert any(expected in line for line in lines), lines
    assert all(line.startswith("r.urdf") for line in lines)


def one_actuator(*entries: str) -> str:
    return "\n".join(["[[actuators]]", *entries])


TOML = {
    "malformed": ("keepout = ", "robot.toml: malformed TOML"),
    "unknown key": ("keepuot = 1", "robot.toml: keepuot: unknown key: did you mean 'keepout'?"),
    "unknown nested key": ("[base]\nkin = 'fixed'", "robot.toml: base.kin: unknown key: did you mean 'kind'?"),
    "wrong type": ("keepout = 'wide'", "robot.toml: keepout: 'wide' is not a finite number"),
    "boolean for a number": ("timestep = true", "robot.toml: timestep: True is not a finite number"),
    "nan": ("keepout = nan", "robot.toml: keepout: nan is not a finite number"),
    "huge": (f"keepout = 1{'0' * 400}", "robot.toml: keepout: "),
    "not positive": ("timestep = 0.0", "robot.toml: timestep: 0.0 must be greater than 0"),
    "no substeps": ("substeps = 0", "robot.toml: substeps: 0 must be at least 1"),
    "fractional substeps": ("substeps = 2.5", "robot.toml: substeps: 2.5 is not a whole number"),
    "no table": ("base = 'fixed'", "robot.toml: base: 'fixed' is not a table"),
    "bad base": ("[base]\nkind = 'planer'", "robot.toml: base.kind: unknown value 'planer': did you mean 'planar'?"),
    "damping of a fixed base": (
        "[base]\nkind = 'fixed'\ndamping = [1, 1, 1]",
        "base.damping: belongs to a planar",
    ),
    "bad triple": ("[base]\nkind = 'planar'\ndamping = [1]", "robot.toml: base.damping: [1] is not a list of 3"),
    "unknown touch link": ("touch = ['c']", "robot.toml: touch: link 'c' does not exist: known: a, b"),
    "unknown home joint": ("[home.joints]\nk = 1.0", "robot.toml: home.joints: joint 'k' does not exist"),
    "unknown friction": ("[friction]\nfoot = 1.0", "robot.toml: friction: link or collision 'foot' does not exist"),
    "negative friction": ("[friction]\na = -1.0", "robot.toml: friction.a: -1.0 must not be negative"),
    "unknown armature": ("[armature]\nk = 1.0", "robot.toml: armature: joint 'k' does not exist"),
    "bad law": (
        one_actuator("name = 'm'", "law = 'torque'", "joint = 'j'"),
        "robot.toml: actuators[0].law: unknown value 'torque'",
    ),
    "no law": (one_actuator("name = 'm'", "joint = 'j'"), "robot.toml: actuators[0].law: is missing: give a text"),
    "unknown joint": (
        one_actuator("name = 'm'", "law = 'effort'", "joint = 'jj'"),
        "robot.toml: actuators[0].joint: joint 'jj' does not exist: did you mean 'j'?",
    ),
    "base joint of a fixed robot": (
        one_actuator("name = 'm'", "law = 'effort'", "joint = 'base_yaw'"),
        "robot.toml: actuators[0].joint: joint 'base_yaw' does not exist",
    ),
    "unknown link": (
        one_actuator("name = 'm'", "law = 'thrust'", "link = 'x'", "direction = [1, 0, 0]"),
        "robot.toml: actuators[0].link: link 'x' does not exist",
    ),
    "no direction": (
        one_actuator("name = 'm'", "law = 'thrust'", "link = 'a'", "direction = [0, 0, 0]"),
        "robot.toml: actuators[0].direction: [0, 0, 0] has no direction",
    ),
    "gain that the law has not": (
        one_actuator("name = 'm'", "law = 'effort'", "joint = 'j'", "kp = 1"),
        "robot.toml: actuators[0].kp: unknown key",
    ),
    "no gain": (
        one_actuator("name = 'm'", "law = 'position'", "joint = 'j'"),
        "robot.toml: actuators[0].kp: is missing",
    ),
    "reversed range": (
        one_actuator("name = 'm'", "law = 'effort'", "joint = 'j'", "ctrl_range = [1, -1]"),
        "robot.toml: actuators[0].ctrl_range: [1, -1] must be increasing",
    ),
    "twice the same name": (
        "\n".join([one_actuator("name = 'm'", "law = 'effort'", "joint = 'j'")] * 2),
        "robot.toml: actuators[1].name: 'm' is taken by actuators[0]",
    ),
    "bad sensor": (
        "[[sensors]]\nkind = 'gyroscope'\nlink = 'a'",
        "robot.toml: sensors[0].kind: unknown value 'gyroscope': did you mean 'gyro'?",
    ),
    "sensor nowhere": (
        "[[sensors]]\nkind = 'gyro'\nlink = 'x'",
        "sensors[0].link: link 'x' does not exist",
    ),
}


@pytest.mark.parametrize("case", TOML)
def test_a_faulty_side_file(case: str, tmp_path: Path) -> None:
    toml, expected = TOML[case]
    lines = complaint(tmp_path, robot(A, B, joint("revolute", rest=LIMIT)), toml)
    assert any(expected in line for line in lines), lines
    assert all(line.startswith("robot.toml: ") for line in lines)


def test_all_problems_of_both_files_come_at_once(tmp_path: Path) -> None:
    urdf = robot(inertial("-1"), f'<link name="b">{BALL}</link>', joint("revolute"), '<link name="c"/>')
    urdf = urdf.replace("</robot>", '<joint name="k" type="fixed"><parent link="a"/><child link="c"/></joint></robot>')
    lines = complaint(tmp_path, urdf, "keepuot = 1\n" + one_actuator("name = 'm'", "law = 'effort'", "joint = 'k'"))
    expected = ["keepuot", "mass -1 kg", "no position limits", "joint 'k' is fixed", "has no <inertial>"]
    assert len(lines) == len(expected)
    for line, word in zip(lines, expected, strict=True):
        assert word in line


def test_an_actuator_on_a_fixed_joint(tmp_path: Path) -> None:
    toml = one_actuator("name = 'm'", "law = 'effort'", "joint = 'j'")
    assert "joint 'j' is fixed" in complaint(tmp_path, robot(A, B, joint("fixed")), toml)[0]


def test_touch_links_of_one_body(tmp_path: Path) -> None:
    lines = complaint(tmp_path, robot(A, B, joint("fixed")), "touch = ['a', 'b']")
    assert lines == ["robot.toml: touch: links 'a' and 'b' are one rigid body 'a': name one of them"]


def test_an_empty_floating_root(tmp_path: Path) -> None:
    lines = complaint(tmp_path, robot('<link name="a"/>', B, joint()), FLOATING)
    assert "r.urdf:2: link 'a' moves but has neither" in lines[0]


def test_reserved_names_of_a_planar_base(tmp_path: Path) -> None:
    lines = complaint(tmp_path, robot(A.replace('"a"', '"base_x"')), '[base]\nkind = "planar"')
    assert lines == ["r.urdf:2: the name 'base_x' belongs to the planar base: rename it"]


def test_a_base_that_is_stated_twice_and_differently(tmp_path: Path) -> None:
    world = '<link name="world"/>'
    ends = '<parent link="world"/><child link="a"/>'
    lines = complaint(tmp_path, robot(world, A, joint("floating", ends=ends)), '[base]\nkind = "planar"')
    assert "robot.toml: base.kind: 'planar' contradicts the floating joint on 'world'" in lines[0]
    lines = complaint(tmp_path, robot(world, A, joint("fixed", ends=ends)), FLOATING)
    assert "robot.toml: base.kind: 'floating' contradicts the root link 'world'" in lines[0]


def test_two_robots_on_one_world(tmp_path: Path) -> None:
    one, two = (joint("floating", ends=f'<parent link="world"/><child link="{name}"/>') for name in "ab")
    lines = complaint(tmp_path, robot('<link name="world"/>', A, B, one, two.replace('"j"', '"k"')))
    assert lines == ["r.urdf:6: joints 'j' and 'k' both hang on 'world': keep one"]


def test_meshes_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "rubbish.stl").write_bytes(b"\x00\x01rubbish")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for name in ("rubbish.stl", "flat.obj"):
        shape = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        (line,) = complaint(tmp_path, robot(link(f"{INERTIAL}{shape}")))
        assert line.startswith(f"r.urdf:2: mesh file '{name}' cannot be used (")


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"nowhere\.urdf: cannot be read"):
        load_robot_file(tmp_path / "nowhere.urdf")
    (tmp_path / "r.urdf").write_text(robot(A))
    with pytest.raises(ModelError, match=r"nowhere\.toml: cannot be read"):
        load_robot_file(tmp_path / "r.urdf", tmp_path / "nowhere.toml")
