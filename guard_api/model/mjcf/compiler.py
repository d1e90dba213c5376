"""How an MJCF file is to be read: `<compiler>` and `<option>`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from guard_api.model.element import Element
from guard_api.model.mjcf.attributes import choice, extended, flag

_MASS_CHANGERS = ("settotalmass", "boundmass", "boundinertia")
"""Attributes that change masses after everything else was read; their neutral values are not positive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiler:
    """Settings of `<compiler>`, with MuJoCo's defaults.

    angle: radians per unit of angle. inertia_from_geoms: None where only bodies without `<inertial>` take it from
    their geoms. inertia_groups: first and last group of geoms that have mass.
    """

    angle: float = math.pi / 180.0
    automatic_limits: bool = True
    inertia_from_geoms: bool | None = None
    inertia_groups: tuple[float, float] = (0.0, 5.0)
    euler_sequence: str = "xyz"
    mesh_folder: str = ""
    strip_path: bool = False


def read_compiler(root: Element) -> Compiler:
    """Return the settings of all `<compiler>` elements, later ones over earlier ones."""
    node = _merged(root, "compiler")
    if node is None:
        return Compiler()
    if choice(node, "coordinate", "local", ("local", "global")) == "global":
        node.error("global coordinates are not supported: save the file with local ones")
    for name in _MASS_CHANGERS:
        if name in node.attributes and node.number(name) > 0.0:
            node.error(f"<compiler> {name} changes masses behind the file's back: write the masses that are meant")
    return Compiler(
        angle=1.0 if choice(node, "angle", "degree", ("degree", "radian")) == "radian" else math.pi / 180.0,
        automatic_limits=flag(node, "autolimits", True),
        inertia_from_geoms={"true": True, "false": False, "auto": None}[
            choice(node, "inertiafromgeom", "auto", ("auto", "true", "false"))
        ],
        inertia_groups=_groups(node),
        euler_sequence=_euler_sequence(node),
        mesh_folder=node.attributes.get("meshdir", node.attributes.get("assetdir", "")),
        strip_path=flag(node, "strippath", False),
    )


def read_timestep(root: Element) -> float | None:
    """Return the physics step [s] that the file states, the only option that belongs to a robot."""
    node = _merged(root, "option")
    if node is None or "timestep" not in node.attributes:
        return None
    timestep = node.number("timestep")
    if timestep <= 0.0:
        node.error(f"<option> timestep {timestep:g} must be positive (seconds)")
    return timestep


def _groups(node: Element) -> tuple[float, float]:
    first, last = node.vector("inertiagrouprange", 2, (0.0, 5.0))
    return first, last


def _euler_sequence(node: Element) -> str:
    sequence = node.attributes.get("eulerseq", "xyz")
    if len(sequence) != 3 or set(sequence) - set("xyzXYZ"):
        node.error(f"<compiler> eulerseq={sequence!r} must be three of x, y, z (turning axes) and X, Y, Z (fixed axes)")
        return "xyz"
    return sequence


def _merged(root: Element, tag: str) -> Element | None:
    """Return the last element `tag` with the attributes of all; MuJoCo lets a file have several."""
    found = list(root.children(tag))
    return extended(found[-1], _union(element.attributes for element in found)) if found else None


def _union(attributes: Iterable[dict[str, str]]) -> dict[str, str]:
    return {name: value for each in attributes for name, value in each.items()}
