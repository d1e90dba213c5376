"""One golden case per kind of problem of a side file, by its key; and problems of both files together."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.model.files import A, B, complaint, hinge, robot

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


def test_touch_links_of_one_body(tmp_path: Path) -> None:
    lines = complaint(tmp_path, robot(A, B, hinge("fixed")), "touch = ['a', 'b']")
    assert lines == ["robot.toml: touch: links 'a' and 'b' are one rigid body 'a': name one of them"]
