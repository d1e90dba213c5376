"""The words of URDF that GUARD reads. The others are noted; a misspelt word is an error, since it loses its meaning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from guard_api.model.element import Element
from guard_api.model.problems import Problems, nearest


@dataclass(frozen=True, slots=True)
class Words:
    """What an element may hold: attributes and children that are read, and those that are known and left out."""

    attributes: tuple[str, ...] = ()
    children: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()


URDF = {
    "robot": Words(("name", "version"), ("link", "joint", "material"), ("transmission", "gazebo", "sensor")),
    "link": Words(("name",), ("inertial", "collision", "visual"), ("contact", "self_collision_checking", "type")),
    "joint": Words(
        ("name", "type"),
        ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic"),
        ("safety_controller", "calibration"),
    ),
    "inertial": Words((), ("origin", "mass", "inertia")),
    "mass": Words(("value",)),
    "inertia": Words(("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
    "collision": Words(("name",), ("origin", "geometry"), ("verbose", "material", "contact_coefficients")),
    "visual": Words(("name",), ("origin", "geometry", "material")),
    "geometry": Words((), ("sphere", "box", "cylinder", "capsule", "mesh"), ("cone", "ellipsoid", "plane")),
    "sphere": Words(("radius",)),
    "box": Words(("size",)),
    "cylinder": Words(("radius", "length")),
    "capsule": Words(("radius", "length")),
    "mesh": Words(("filename", "scale"), ignored=("convex",)),
    "material": Words(("name",), ("color",), ("texture",)),
    "color": Words(("rgba",)),
    "origin": Words(("xyz", "rpy", "quat_xyzw")),
    "parent": Words(("link",)),
    "child": Words(("link",)),
    "axis": Words(("xyz",)),
    "limit": Words(("lower", "upper", "effort", "velocity"), ignored=("acceleration", "deceleration", "jerk")),
    "dynamics": Words(("damping", "friction"), ignored=("spring_reference", "spring_stiffness", "armature")),
    "mimic": Words(("joint", "multiplier", "offset")),
}


def check_vocabulary(
    root: Element, problems: Problems, language: Mapping[str, Words] = URDF, name: str = "URDF"
) -> None:
    """Report misspelt elements and attributes as errors and foreign ones as notes, one for each word.

    language: what each element of the format called `name` may hold.
    """
    foreign: dict[str, list[Element]] = {}
    for element in known_elements(root, language):
        words = language[element.tag]
        for key in element.attributes:
            place = f"attribute {key!r} in <{element.tag}>"
            if key not in words.attributes and not _misspelt(element, key, words.attributes, words.ignored, place):
                foreign.setdefault(f"attribute {key} of <{element.tag}>", []).append(element)
        for child in element.children():
            place = f"{child.tag!r} in <{name}>"
            if child.tag not in words.children and not _misspelt(
                child, child.tag, words.children, words.ignored, place
            ):
                foreign.setdefault(f"<{_local(child.tag)}> in <{element.tag}>", []).append(child)
    for word, places in foreign.items():
        times = f"{len(places)} times, first at" if len(places) > 1 else "at"
        problems.note(f"{root.file.name}: {word} is ignored ({times} line {places[0].line})")


def known_elements(root: Element, language: Mapping[str, Words]) -> Iterator[Element]:
    """Yield `root` and every element below that is reached through elements that are read, in file order."""
    pending = [root]
    while pending:
        element = pending.pop()
        yield element
        pending.extend([child for child in element.children() if child.tag in language[element.tag].children][::-1])


def _misspelt(node: Element, word: str, known: tuple[str, ...], ignored: tuple[str, ...], place: str) -> bool:
    if "www.ros.org/wiki/xacro" in word:
        node.error("xacro macros are not URDF: expand the file with xacro first")
        return True
    near = None if word in ignored else nearest(word, known)
    if near:
        node.error(f"unknown {place}: did you mean {near!r}?")
    return near is not None


def _local(tag: str) -> str:
    """Return a tag without its XML namespace."""
    return tag.rpartition("}")[2]
