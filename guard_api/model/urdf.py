"""Reads URDF into a `Tree`: strict about what it uses, with every fault of a file reported at its line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias, cast, get_args

import numpy as np

from guard_api import rotations
from guard_api.model.element import Element, parse
from guard_api.model.geometry import read_geometry
from guard_api.model.inertia import UNIT_INERTIA, MassProperties, as_vector, impossibility, moved
from guard_api.model.problems import Problems, did_you_mean
from guard_api.model.robot import Visual
from guard_api.model.tree import Tree, TreeCollision, TreeJoint, TreeJointKind, TreeLink
from guard_api.model.vocabulary import check_vocabulary
from guard_api.shapes import Pose, Quaternion

HEAVIEST = 1e5
"""Mass [kg] beyond which a link is noted as probably given in another unit."""

_LIMITED = {"revolute", "prismatic"}
_WITHOUT_AXIS = {"fixed", "floating", "ball"}

Rgba: TypeAlias = tuple[float, float, float, float]


def read_urdf(path: Path, problems: Problems) -> Tree | None:
    """Return what the URDF file at `path` says, in file order; None when nothing of it can be read.

    Faults go to `problems`; where there are any, the tree holds stand-ins and must not be used as a robot.
    """
    root = parse(path, problems)
    if root is None:
        return None
    if root.tag != "robot":
        root.error(f"the outermost element is <{root.tag}>: a URDF begins with <robot name=...>")
        return None
    check_vocabulary(root, problems)
    colours: dict[str, Rgba | None] = {
        node.attributes.get("name", ""): _rgba(node) for node in root.children("material")
    }
    tree = Tree(
        name=root.text("name"),
        links=tuple(_link(node, colours) for node in root.children("link")),
        joints=tuple(_joint(node) for node in root.children("joint")),
    )
    if not tree.links:
        root.error("<robot> has no <link>: add one")
    return tree


def _link(node: Element, colours: dict[str, Rgba | None]) -> TreeLink:
    inertial = node.child("inertial")
    return TreeLink(
        name=node.text("name"),
        place=f"{node.file}:{node.line}",
        properties=_inertial(inertial, node.attributes.get("name", "")) if inertial else None,
        collisions=tuple(shape for child in node.children("collision") if (shape := _collision(child))),
        visuals=tuple(shape for child in node.children("visual") if (shape := _visual(child, colours))),
    )


def _inertial(node: Element, link: str) -> MassProperties:
    mass_node, inertia_node = node.child("mass", required=True), node.child("inertia", required=True)
    mass = mass_node.number("value") if mass_node else 1.0
    if mass_node and mass <= 0.0:
        mass_node.error(f"link {link!r}: mass {mass:g} kg must be positive; a link without mass has no <inertial>")
        mass = 1.0
    if mass_node and mass > HEAVIEST:
        mass_node.note(f"link {link!r} has a mass of {mass:g} kg: masses are in kilograms")
    inertia = UNIT_INERTIA
    if inertia_node:
        xx, yy, zz = (inertia_node.number(name) for name in ("ixx", "iyy", "izz"))
        xy, xz, yz = (inertia_node.number(name, 0.0) for name in ("ixy", "ixz", "iyz"))
        inertia = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        reason = impossibility(inertia)
        if reason:
            inertia_node.error(f"link {link!r}: no rigid body has this inertia: {reason}")
            inertia = UNIT_INERTIA
    return moved(MassProperties(mass=mass, com=(0.0, 0.0, 0.0), inertia=inertia), _origin(node))


def _collision(node: Element) -> TreeCollision | None:
    shape = read_geometry(node)
    pose = _origin(node)
    return TreeCollision(name=node.attributes.get("name", ""), shape=shape, pose=pose) if shape else None


def _visual(node: Element, colours: dict[str, Rgba | None]) -> Visual | None:
    shape, pose, material = read_geometry(node), _origin(node), node.child("material")
    if shape is None:
        return None
    visual = Visual(shape=shape, pose=pose)
    if material is None:
        return visual
    name = material.attributes.get("name", "")
    rgba = _rgba(material) or colours.get(name)
    if name:
        colours.setdefault(name, rgba)  # a later visual may use the material by its name
    if rgba is None:
        material.note(f"material {name!r} has no colour up to here: the default is used")
        return visual
    return replace(visual, rgba=rgba)


def _rgba(material: Element) -> Rgba | None:
    color = material.child("color")
    if color is None:
        return None
    r, g, b, a = color.vector("rgba", 4)
    if min(r, g, b, a) < 0.0 or max(r, g, b, a) > 1.0:
        color.note("colours lie between 0 and 1: rgba is clipped")
    r, g, b, a = (min(max(value, 0.0), 1.0) for value in (r, g, b, a))
    return r, g, b, a


def _origin(node: Element) -> Pose:
    origin = node.child("origin")
    if origin is None:
        return Pose()
    position = as_vector(origin.vector("xyz", 3, (0.0, 0.0, 0.0)))
    if "quat_xyzw" in origin.attributes:
        if "rpy" in origin.attributes:
            origin.error("<origin> has both rpy and quat_xyzw: keep one")
        x, y, z, w = origin.vector("quat_xyzw", 4)
        return Pose(position=position, quaternion=_unit_quaternion(origin, w, x, y, z))
    rpy = origin.vector("rpy", 3, (0.0, 0.0, 0.0))
    if max(map(abs, rpy)) > 2.0 * math.pi:
        origin.note(f"rpy {' '.join(f'{angle:g}' for angle in rpy)} looks like degrees: angles are in radians")
    if not any(rpy):
        return Pose(position=position)
    w, x, y, z = rotations.from_rpy(*rpy)
    return Pose(position=position, quaternion=_unit_quaternion(origin, w, x, y, z))


def _unit_quaternion(node: Element, w: float, x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion with norm 1 and w >= 0."""
    norm = math.copysign(math.hypot(w, x, y, z), w)
    if norm == 0.0:
        node.error("quat_xyzw is zero: it must have norm 1")
        return Pose().quaternion
    return float(w / norm), float(x / norm), float(y / norm), float(z / norm)


def _joint(node: Element) -> TreeJoint:
    kind = _kind(node)
    name = node.text("name")
    if node.child("mimic"):
        node.error(f"joint {name!r}: <mimic> is not supported: remove it and drive the joint by an actuator of its own")
    parent, child = node.child("parent", required=True), node.child("child", required=True)
    dynamics = node.child("dynamics")
    damping, friction = (dynamics.number("damping", 0.0), dynamics.number("friction", 0.0)) if dynamics else (0.0, 0.0)
    if dynamics and min(damping, friction) < 0.0:
        dynamics.error(f"joint {name!r}: damping {damping:g} and friction {friction:g} must not be negative")
    effort, velocity = _bounds(node, name)
    return TreeJoint(
        name=name,
        kind=kind,
        parent=parent.text("link") if parent else "",
        child=child.text("link") if child else "",
        place=f"{node.file}:{node.line}",
        origin=_origin(node),
        axis=_axis(node, kind, name),
        limits=_limits(node, kind, name),
        damping=damping,
        friction_loss=friction,
        effort_limit=effort,
        velocity_limit=velocity,
    )


def _kind(node: Element) -> TreeJointKind:
    kind, known = node.text("type"), get_args(TreeJointKind)
    if kind == "ball":
        node.note("the joint type ball is an extension of GUARD: other readers of URDF refuse it")
    if kind in known:
        return cast(TreeJointKind, kind)
    if kind:
        node.error(
            f"joint {node.attributes.get('name', '')!r} has the unknown type {kind!r}: {did_you_mean(kind, known)}"
        )
    return "fixed"


def _axis(node: Element, kind: TreeJointKind, name: str) -> tuple[float, float, float]:
    axis = node.child("axis")
    if axis is None:
        if kind == "planar":
            node.note(f"joint {name!r} has no <axis>: its plane is taken to be horizontal")
            return 0.0, 0.0, 1.0
        if kind not in _WITHOUT_AXIS:
            node.note(f"joint {name!r} has no <axis>: it is x, as URDF says")
        return 1.0, 0.0, 0.0
    if kind == "ball":
        axis.note(f"joint {name!r} is a ball: its axis is ignored")
    x, y, z = axis.vector("xyz", 3)
    norm = math.hypot(x, y, z)
    if norm == 0.0 and kind not in _WITHOUT_AXIS:
        axis.error(f"joint {name!r}: the axis is zero: give it a direction")
    if norm == 0.0:
        return 1.0, 0.0, 0.0
    if abs(norm - 1.0) > 1e-6:
        axis.note(f"joint {name!r}: the axis has length {norm:g} and is normalised")
    return as_vector(np.array([x, y, z]) / norm)


def _limits(node: Element, kind: TreeJointKind, name: str) -> tuple[float, float] | None:
    limit = node.child("limit")
    given = [end for end in ("lower", "upper") if limit and end in limit.attributes]
    if kind not in _LIMITED:
        if limit and given and kind in {"continuous", "ball"}:
            limit.note(f"{kind} joint {name!r} turns freely: its position limits are ignored")
        return None
    if limit is None or not given:
        free = ", or make it continuous" if kind == "revolute" else ""
        (limit or node).error(f"{kind} joint {name!r} has no position limits: add <limit lower=... upper=.../>{free}")
        return None
    for end in {"lower", "upper"}.difference(given):
        limit.note(f"joint {name!r} has no {end} limit: it is 0, as URDF says")
    lower, upper = limit.number("lower", 0.0), limit.number("upper", 0.0)
    if lower >= upper:
        remedy = "make it fixed" if lower == upper else "exchange them"
        limit.error(f"joint {name!r}: lower limit {lower:g} is not below upper limit {upper:g}: {remedy}")
    if kind == "revolute" and max(abs(lower), abs(upper)) > 2.0 * math.pi:
        limit.note(f"joint {name!r}: limits {lower:g}, {upper:g} exceed a turn: angles are in radians, not degrees")
    return lower, upper


def _bounds(node: Element, name: str) -> tuple[float, float]:
    """Return effort and velocity limit; infinite where the file gives none."""
    limit = node.child("limit")
    return _bound(limit, "effort", name), _bound(limit, "velocity", name)


def _bound(limit: Element | None, key: str, name: str) -> float:
    if limit is None or key not in limit.attributes:
        return math.inf
    value = limit.number(key)
    if value < 0.0:
        limit.error(f"joint {name!r}: {key} limit {value:g} must not be negative")
    if value == 0.0 and key == "effort":
        limit.note(f"joint {name!r}: its effort limit is 0, so nothing can drive it; leave it out if it is unknown")
    return value
