"""Actuators: motors on joints and sites, position and velocity servos, and general ones that are one of these."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from guard_api import rotations
from guard_api.model.element import Element
from guard_api.model.inertia import as_vector
from guard_api.model.mjcf.attributes import choice, increasing, limited, numbers, symmetric_bound
from guard_api.model.mjcf.bodies import Bodies, Moved
from guard_api.model.mjcf.compiler import Compiler
from guard_api.model.mjcf.defaults import ACTUATORS
from guard_api.model.mjcf.document import Document
from guard_api.model.problems import did_you_mean
from guard_api.model.robot import Actuator

_TRANSMISSIONS = ("joint", "jointinparent", "site", "tendon", "body", "cranksite", "slidersite", "refsite")
_NEUTRAL = {"timeconst": 0.0, "dampratio": 0.0, "delay": 0.0, "armature": 0.0, "damping": 0.0, "actdim": 0.0}
"""Attributes of which any other value would make another actuator."""


class _Force(NamedTuple):
    """The force that an actuator applies before its gear: gain u + bias + stiffness length + damping velocity."""

    gain: float = 1.0
    bias: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


def read_actuators(
    root: Element, bodies: Bodies, document: Document, stated: Mapping[str, Actuator]
) -> Iterator[Actuator]:
    """Yield the actuators of the file in order, those that the side file has `stated` by name in its words."""
    places: dict[str, int] = {}
    for section in root.children("actuator"):
        for written in section.children():
            node = document.defaults.applied(written, None)
            name = node.attributes.get("name") or node.attributes.get("joint") or node.attributes.get("site", "")
            if not name:
                node.error(f"<{node.tag}> has no name: add name=...")
            if name in places:
                node.error(f"actuator name {name!r} is taken already (line {places[name]}): rename one")
            places[name] = node.line
            if name in stated:
                yield stated[name]
            elif node.tag not in ACTUATORS:
                node.error(f"actuator {name!r}: <{node.tag}> is not supported: use {', '.join(ACTUATORS)}")
            else:
                yield _actuator(node, name, bodies, document.compiler)


def _actuator(node: Element, name: str, bodies: Bodies, compiler: Compiler) -> Actuator:
    _refuse(node, name)
    on = [key for key in _TRANSMISSIONS if key in node.attributes]
    if len(on) != 1 or on[0] not in {"joint", "jointinparent", "site"}:
        node.error(f"actuator {name!r} acts on {' and '.join(on) or 'nothing'}: give one joint or one site")
        return Actuator(name=name, law="effort")
    gear = numbers(node, "gear", 1, 6, (1.0,))
    if on[0] == "site":
        return _thrust(node, name, gear, bodies, compiler)
    moved = bodies.moved.get(node.attributes[on[0]])
    if moved is None:
        node.error(
            f"actuator {name!r}: joint {node.attributes[on[0]]!r} does not exist: "
            f"{did_you_mean(node.attributes[on[0]], bodies.moved)}"
        )
        return Actuator(name=name, law="effort")
    if moved.joint.kind in {"ball", "floating"} or gear[0] == 0.0:
        node.error(f"actuator {name!r}: it must act on a hinge or slide, with a gear other than 0")
        return Actuator(name=name, law="effort")
    return _on_joint(node, name, gear[0], moved, compiler)


def _on_joint(node: Element, name: str, g: float, moved: Moved, compiler: Compiler) -> Actuator:
    """Return the neutral law: lengths and velocities are `g` times those of the joint, and so is the joint's effort.

    g (gain u + bias + stiffness g q + damping g qd) = kp (gear u + offset - q) - kd qd, or kd (gear u + offset - qd).
    """
    force = _force(node, name)
    kp, kd = 0.0 - force.stiffness * g * g, 0.0 - force.damping * g * g
    if kp < 0.0 or kd < 0.0:
        node.error(
            f"actuator {name!r}: its force grows with the joint's position or velocity: gains must not be negative"
        )
    if force.gain == 0.0:
        node.error(f"actuator {name!r}: its gain is 0, so the control does nothing: give another or remove it")
    if kp == kd == 0.0 and force.bias:
        node.error(f"actuator {name!r}: a constant force without a servo is not supported: remove the bias")
    target = kp or kd or g
    return Actuator(
        name=name,
        law="position" if kp else ("velocity" if kd else "effort"),
        joint=moved.name,
        gear=force.gain * g / target if kp or kd else force.gain * g,
        offset=force.bias * g / target if kp or kd else 0.0,
        ctrl_range=_ctrl_range(node, name, moved, compiler),
        kp=max(kp, 0.0),
        kd=max(kd, 0.0),
        effort_limit=abs(g) * _force_limit(node, compiler),
    )


def _thrust(node: Element, name: str, gear: tuple[float, ...], bodies: Bodies, compiler: Compiler) -> Actuator:
    site = bodies.sites.get(node.attributes["site"])
    force = _force(node, name)
    vector = np.zeros(6)
    vector[: len(gear)] = gear
    size = float(np.linalg.norm(vector[:3]))
    if site is None:
        node.error(
            f"actuator {name!r}: site {node.attributes['site']!r} does not exist on the robot: "
            f"{did_you_mean(node.attributes['site'], bodies.sites)}"
        )
    if vector[3:].any() or size == 0.0:
        node.error(f"actuator {name!r}: a site takes a force, gear='x y z 0 0 0' in its axes, and no torque")
    if force[2:] != (0.0, 0.0) or force.gain == 0.0:
        node.error(f"actuator {name!r}: a servo on a site is not supported: use <motor>")
    if site is None or size == 0.0:
        return Actuator(name=name, law="thrust")
    return Actuator(
        name=name,
        law="thrust",
        link=site.link,
        point=site.pose.position,
        direction=as_vector(rotations.rotate(site.pose.quaternion, vector[:3] / size)),
        gear=force.gain * size,
        offset=force.bias * size,
        ctrl_range=_ctrl_range(node, name, None, compiler),
        effort_limit=size * _force_limit(node, compiler),
    )


def _force(node: Element, name: str) -> _Force:
    match node.tag:
        case "motor":
            return _Force()
        case "position":
            kp = node.number("kp", 1.0)
            return _Force(gain=kp, stiffness=-kp, damping=-node.number("kv", 0.0))
        case "velocity":
            kv = node.number("kv", 1.0)
            return _Force(gain=kv, damping=-kv)
    for key, known in (("dyntype", "none"), ("gaintype", "fixed")):
        if node.attributes.get(key, known) != known:
            node.error(f"actuator {name!r}: {key}={node.attributes[key]!r} is not supported, only {known!r}")
    gain = numbers(node, "gainprm", 1, 10, (1.0,))[0]
    if choice(node, "biastype", "none", ("none", "affine")) == "none":
        return _Force(gain=gain)
    bias = (*numbers(node, "biasprm", 1, 10, (0.0,)), 0.0, 0.0)
    return _Force(gain, *bias[:3])


def _ctrl_range(node: Element, name: str, moved: Moved | None, compiler: Compiler) -> tuple[float, float]:
    share = node.number("inheritrange", 0.0)
    if share:
        if moved is None or moved.joint.limits is None or "ctrlrange" in node.attributes:
            node.error(f"actuator {name!r}: inheritrange needs a joint with a range, and no ctrlrange of its own")
            return -1.0, 1.0
        lower, upper = moved.joint.limits
        middle, half = 0.5 * (lower + upper), 0.5 * share * (upper - lower)
        return middle - half, middle + half
    if limited(node, "ctrllimited", "ctrlrange", compiler.automatic_limits):
        return increasing(node, "ctrlrange")
    node.error(f"actuator {name!r}: its control is not limited, and an action has bounds: add ctrlrange=...")
    return -1.0, 1.0


def _force_limit(node: Element, compiler: Compiler) -> float:
    if limited(node, "forcelimited", "forcerange", compiler.automatic_limits):
        return symmetric_bound(node, "forcerange")
    return math.inf


def _refuse(node: Element, name: str) -> None:
    """Report what would make another actuator if it were left out."""
    for key, neutral in _NEUTRAL.items():
        if node.number(key, neutral) != neutral:
            node.error(f"actuator {name!r}: {key} is not supported: remove it")
