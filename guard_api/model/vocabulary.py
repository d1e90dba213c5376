"""The words of URDF that GUARD reads. The others are noted; a misspelt word is an error, since it loses its meaning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from guard_api.model.element import Element
from guard_api.model.problems import Problems, nearest


@dataclass(frozen=True, slots=True)
class _Words:
    """What an element may hold: attributes and children that are read, and those that are known and left out."""

    attributes: tuple[str, ...] = ()
    children: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()


_URDF = {
    "robot": _Words(("name", "version"), ("link", "joint", "material"), ("transmission", "gazebo", "sensor")),
    "link": _Words(("name",), ("inertial", "collision", "visual"), ("contact", "self_collision_checking", "type")),
    "joint": _Words(
        ("name", "type"),
        ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic"),
        ("safety_controller", "calibration"),
    ),
    "inertial": _Words((), ("origin", "mass", "inertia")),
    "mass": _Words(("value",)),
    "inertia": _Words(("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
    "collision": _Words(("name",), ("origin", "geometry"), ("verbose", "material", "contact_coefficients")),
    "visual": _Words(("name",), ("origin", "geometry", "material")),
    "geometry": _Words((), ("sphere", "box", "cylinder", "capsule", "mesh"), ("cone", "ellipsoid", "plane")),
    "sphere": _Words(("radius",)),
    "box": _Words(("size",)),
    "cylinder": _Words(("radius", "length")),
    "capsule": _Words(("radius", "length")),
    "mesh": _Words(("filename", "scale"), ignored=("convex",)),
    "material": _Words(("name",), ("color",), ("texture",)),
    "color": _Words(("rgba",)),
    "origin": _Words(("xyz", "rpy", "quat_xyzw")),
    "parent": _Words(("link",)),
    "child": _Words(("link",)),
    "axis": _Words(("xyz",)),
    "limit": _Words(("lower", "upper", "effort", "velocity"), ignored=("acceleration", "deceleration", "jerk")),
    "dynamics": _Words(("damping", "friction"), ignored=("spring_reference", "spring_stiffness", "armature")),
    "mimic": _Words(("joint", "multiplier", "offset")),
}


def check_vocabulary(root: Element, problems: Problems) -> None:
    """Report misspelt elements and attributes as errors and foreign ones as notes, one for each word."""
    foreign: dict[str, list[Element]] = {}
    for element in _known_elements(root):
        words = _URDF[element.tag]
        for name in element.attributes:
            if name not in words.attributes and not _misspelt(
                element, name, words.attributes, words.ignored, "attribute "
            ):
                foreign.setdefault(f"attribute {name} of <{element.tag}>", []).append(element)
        for child in element.children():
            if child.tag not in words.children and not _misspelt(child, child.tag, words.children, words.ignored, ""):
                foreign.setdefault(f"<{_local(child.tag)}> in <{element.tag}>", []).append(child)
    for word, places in foreign.items():
        times = f"{len(places)} times, first at" if len(places) > 1 else "at"
        problems.note(f"{root.file.name}: {word} is ignored ({times} line {places[0].line})")


def _known_elements(root: Element) -> Iterator[Element]:
    pending = [root]
    while pending:
        element = pending.pop()
        yield element
        pending.extend(child for child in element.children() if child.tag in _URDF[element.tag].children)


def _misspelt(place: Element, word: str, known: tuple[str, ...], ignored: tuple[str, ...], kind: str) -> bool:
    if "www.ros.org/wiki/xacro" in word:
        place.error("xacro macros are not URDF: expand the file with xacro first")
        return True
    near = None if word in ignored else nearest(word, known)
    if near:
        place.error(f"unknown {kind}{word!r} in <{place.tag if kind else 'URDF'}>: did you mean {near!r}?")
    return near is not None


def _local(tag: str) -> str:
    """Return a tag without its XML namespace."""
    return tag.rpartition("}")[2]
