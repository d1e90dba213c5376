"""One golden case per kind of problem of a side file, by its key; and problems of both files together."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.model.files import A, B, complaint, hinge, load_text, robot

BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
LIMIT = '<limit lower="-1" upper="1"/>'


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
    "bad spring of the base": (
        "[base]\nkind = 'planar'\nstiffness = [1, -1, 1]",
        "robot.toml: base.stiffness: [1.0, -1.0, 1.0] must not be negative",
    ),
    "rest position of a floating base": (
        "[base]\nkind = 'floating'\nrest_position = [1, 1, 1]",
        "base.rest_position: belongs to a planar",
    ),
    "touch as a list": ("touch = ['a']", "robot.toml: touch: unknown key"),
    "unknown reference": ("reference = 'c'", "robot.toml: reference: link 'c' does not exist: known: a, b"),
    "reference as a list": ("reference = ['a']", "robot.toml: reference: ['a'] is not a text"),
    "unknown lidar": ("lidar = ['a', 'c']", "robot.toml: lidar: link 'c' does not exist: known: a, b"),
    "lidar twice": ("lidar = ['a', 'b', 'a']", "robot.toml: lidar: link 'a' is named twice: name it once"),
    "unknown end": (
        "[[segments]]\nstart = 'a'\nend = 'c'",
        "robot.toml: segments[0].end: link 'c' does not exist: known: a, b",
    ),
    "segment without end": ("[[segments]]\nstart = 'a'", "robot.toml: segments[0].end: is missing: give a text"),
    "segment of negative thickness": (
        "[[segments]]\nstart = 'a'\nend = 'b'\nradius = -1",
        "robot.toml: segments[0].radius: -1 must be at least 0",
    ),
    "unknown home joint": ("[home.joints]\nk = 1.0", "robot.toml: home.joints: joint 'k' does not exist"),
    "unknown friction": ("[friction]\nfoot = 1.0", "robot.toml: friction: link or collision 'foot' does not exist"),
    "negative friction": ("[friction]\na = -1.0", "robot.toml: friction.a: -1.0 must be at least 0"),
    "unknown armature": ("[armature]\nk = 1.0", "robot.toml: armature: joint 'k' does not exist"),
    "unknown damping": ("[damping]\nk = 1.0", "robot.toml: damping: joint 'k' does not exist"),
    "negative damping": ("[damping]\nj = -1.0", "robot.toml: damping.j: -1.0 must be at least 0"),
    "unknown spring": ("[stiffness]\nk = 1.0", "robot.toml: stiffness: joint 'k' does not exist"),
    "negative stiffness": ("[stiffness]\ndefault = -1.0", "robot.toml: stiffness.default: -1.0 must be at least 0"),
    "unknown rest": ("[rest_position]\nk = 1.0", "robot.toml: rest_position: joint 'k' does not exist"),
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
    "offset of a torque": (
        one_actuator("name = 'm'", "law = 'effort'", "joint = 'j'", "offset = 1"),
        "robot.toml: actuators[0].offset: unknown key",
    ),
    "ceiling of a servo": (
        one_actuator("name = 'm'", "law = 'velocity'", "joint = 'j'", "kd = 1", "ceiling = 1"),
        "robot.toml: actuators[0].ceiling: unknown key",
    ),
    "negative gain": (
        one_actuator("name = 'm'", "law = 'position'", "joint = 'j'", "kp = 1", "kd = -1"),
        "robot.toml: actuators[0].kd: -1 must be at least 0",
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
    "sensor of no joint": (
        "[[sensors]]\nkind = 'joint_position'\njoint = 'x'",
        "sensors[0].joint: joint 'x' does not exist",
    ),
    "joint sensor on a link": (
        "[[sensors]]\nkind = 'joint_velocity'\nlink = 'a'",
        "robot.toml: sensors[0].joint: is missing: give a text",
    ),
    "range of a gyro": ("[[sensors]]\nkind = 'gyro'\nlink = 'a'\nradius = 1", "sensors[0].radius: unknown key"),
    "axes of a touch sensor": (
        "[[sensors]]\nkind = 'touch'\nlink = 'a'\nrpy = [0, 0, 0]",
        "sensors[0].rpy: unknown key",
    ),
    "touch of no range": (
        "[[sensors]]\nkind = 'touch'\nlink = 'a'\nradius = 0",
        "sensors[0].radius: 0 must be greater than 0",
    ),
    "touch twice": (
        "[[sensors]]\nkind = 'touch'\nlink = 'a'\nradius = 1\n" * 2,
        "robot.toml: sensors[1].name: 'touch_a' is taken by sensors[0]",
    ),
    "rotation of the root": (
        "[[sensors]]\nkind = 'relative_rotation'\nlink = 'a'",
        "robot.toml: sensors[0].link: link 'a' is the root: no link before it",
    ),
}


@pytest.mark.parametrize("case", TOML)
def test_a_faulty_side_file(case: str, tmp_path: Path) -> None:
    toml, expected = TOML[case]
    lines = complaint(tmp_path, robot(A, B, hinge("revolute", rest=LIMIT)), toml)
    assert any(expected in line for line in lines), lines
    assert all(line.startswith("robot.toml: ") for line in lines)


def test_all_problems_of_both_files_come_at_once(tmp_path: Path) -> None:
    urdf = robot(
        A.replace('value="1"', 'value="-1"'), f'<link name="b">{BALL}</link>', hinge("revolute"), '<link name="c"/>'
    )
    urdf = urdf.replace("</robot>", '<joint name="k" type="fixed"><parent link="a"/><child link="c"/></joint></robot>')
    lines = complaint(tmp_path, urdf, "keepuot = 1\n" + one_actuator("name = 'm'", "law = 'effort'", "joint = 'k'"))
    expected = ["keepuot", "mass -1 kg", "no position limits", "joint 'k' is fixed", "has no <inertial>"]
    assert len(lines) == len(expected)
    for line, word in zip(lines, expected, strict=True):
        assert word in line


def test_an_actuator_on_a_fixed_joint(tmp_path: Path) -> None:
    toml = one_actuator("name = 'm'", "law = 'effort'", "joint = 'j'")
    assert "joint 'j' is fixed" in complaint(tmp_path, robot(A, B, hinge("fixed")), toml)[0]


def test_two_touch_sensors_on_all_of_one_body(tmp_path: Path) -> None:
    on_a, on_b = (f"[[sensors]]\nkind = 'touch'\nlink = '{name}'\n" for name in "ab")
    lines = complaint(tmp_path, robot(A, B, hinge("fixed")), on_a + on_b)
    assert lines == [
        "robot.toml: sensors[1].link: touch on links 'a' and 'b': they are one rigid body 'a': remove a sensor, or "
        "tell them apart by position and radius"
    ]
    load_text(tmp_path, robot(A, B, hinge("fixed")), f"{on_a}radius = 1.0\n{on_b}radius = 1.0\nposition = [1, 0, 0]")


def test_a_rotation_of_what_does_not_turn(tmp_path: Path) -> None:
    toml = "[[sensors]]\nkind = 'relative_angular_velocity'\nlink = 'b'"
    lines = complaint(tmp_path, robot(A, B, hinge("fixed")), toml)
    assert lines == ["robot.toml: sensors[0].link: link 'b' is fixed to 'a': name a link that hangs on a moving joint"]


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_nothing_sits_on_the_world_that_the_robot_moves_in(kind: str, tmp_path: Path) -> None:
    free = hinge(kind, ends='<parent link="world"/><child link="a"/>')
    toml = "reference = 'world'\n[[sensors]]\nkind = 'gyro'\nlink = 'world'"
    lines = complaint(tmp_path, robot('<link name="world"/>', A, free), toml)
    assert lines == [
        "robot.toml: sensors[0].link: link 'world' does not exist: known: a",
        "robot.toml: reference: link 'world' does not exist: known: a",
    ]
