"""Small robot files for the readers' tests, one element on a line."""

from __future__ import annotations

from pathlib import Path

import pytest

from guard_api.errors import ModelError
from guard_api.model.library import load_robot_file
from guard_api.model.robot import RobotModel

INERTIAL = '<inertial><mass value="{mass}"/><inertia ixx="{i}" iyy="{i}" izz="{i}"/></inertial>'
ONE = INERTIAL.format(mass=1, i=1)
A, B = (f'<link name="{name}">{ONE}</link>' for name in "ab")
ENDS = '<parent link="a"/><child link="b"/>'
Z = '<axis xyz="0 0 1"/>'


def robot(*lines: str) -> str:
    """A robot whose n-th line, counted from 1 for <robot>, is lines[n - 2]."""
    return "\n".join(['<robot name="r">', *lines, "</robot>"])


def link(name: str, content: str = "", mass: float = 1.0) -> str:
    return f'<link name="{name}">{INERTIAL.format(mass=mass, i=0.1 * mass)}{content}</link>'


def joint(name: str, kind: str, parent: str, child: str, rest: str = "", xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{rest}</joint>'
    )


def hinge(kind: str = "continuous", *, ends: str = ENDS, rest: str = "") -> str:
    """A joint j between the links A and B."""
    return f'<joint name="j" type="{kind}">{ends}{Z}{rest}</joint>'


def load(folder: Path, *lines: str, toml: str | None = None) -> RobotModel:
    """The robot of these lines, with this side file or none."""
    return load_text(folder, robot(*lines), toml)


def load_text(folder: Path, urdf: str, toml: str | None) -> RobotModel:
    (folder / "r.urdf").write_text(urdf)
    if toml is not None:
        (folder / "robot.toml").write_text(toml)
    return load_robot_file(folder / "r.urdf")


def complaint(folder: Path, urdf: str, toml: str | None = None) -> list[str]:
    """The lines of the error that this file raises, without the folder."""
    with pytest.raises(ModelError) as caught:
        load_text(folder, urdf, toml)
    return str(caught.value).replace(f"{folder}/", "").splitlines()
