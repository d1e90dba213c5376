"""The tree of bodies below `<worldbody>`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from guard_api.model.base import WORLD
from guard_api.model.element import Element
from guard_api.model.merge import compose
from guard_api.model.mjcf.attributes import flag
from guard_api.model.mjcf.document import Document
from guard_api.model.mjcf.geoms import collision, read_geom, visual
from guard_api.model.mjcf.inertial import from_geoms, read_inertial
from guard_api.model.mjcf.joints import BodyJoint, chain, read_joint
from guard_api.model.mjcf.placement import read_ends, read_pose
from guard_api.model.mjcf.standing import Standing, stand
from guard_api.model.robot import PLANAR_JOINTS, BaseKind
from guard_api.model.tree import TreeJoint, TreeLink
from guard_api.shapes import Pose


class Site(NamedTuple):
    """A named place: its element, defaults applied, and its pose in the axes of `link`."""

    node: Element
    link: str
    pose: Pose


class Moved(NamedTuple):
    """A joint as actuators and sensors find it: its name in the model, the joint as written, and the body it moves."""

    name: str
    joint: TreeJoint
    body: str


@dataclass(frozen=True, slots=True)
class Bodies:
    """What was found: links and joints for a `Tree`, named places, joints by their names in the file.

    start: the joints' values where they are not drawn at 0. standing: of the outermost body, once one was found.
    """

    links: list[TreeLink] = field(default_factory=list)
    joints: list[TreeJoint] = field(default_factory=list)
    sites: dict[str, Site] = field(default_factory=dict)
    moved: dict[str, Moved] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    standing: list[Standing] = field(default_factory=list)


class _Child(NamedTuple):
    """An element in a body, out of the `<frame>`s around it, with their pose in body axes and the class they set."""

    node: Element
    frame: Pose
    childclass: str | None


def read_bodies(root: Element, document: Document, base: BaseKind | None) -> Bodies:
    """Return the bodies of the file; `base` is the kind that the side file states."""
    found = Bodies()
    worlds = list(root.children("worldbody"))
    reader = _Reader(document, found, {name for world in worlds for name in _names(world)}, base)
    outermost = [child for world in worlds for child in _opened(world, None, document) if child.node.tag == "body"]
    for child in outermost[:1]:
        reader.read(child, WORLD, "body")
    for child in outermost[1:]:
        child.node.error("a second body in <worldbody>: a robot has one root; put the others into the scene")
    if not outermost:
        root.error("<mujoco> has no <worldbody> with a <body>: add one")
    return found


class _Reader:
    """Reads bodies one inside the other into `found`; `taken` are the names that the file gives to bodies."""

    def __init__(self, document: Document, found: Bodies, taken: set[str], base: BaseKind | None) -> None:
        self._document = document
        self._found = found
        self._taken = taken
        self._base: BaseKind | None = base

    def read(self, child: _Child, parent: str, default_name: str) -> None:
        """Read a body that stands in `parent`, and all that it carries."""
        node, document = child.node, self._document
        name = _name(node, default_name)
        childclass = node.attributes.get("childclass", child.childclass)
        document.defaults.check_class(node, childclass)
        _refuse(node, name)
        parts = [
            part._replace(node=document.defaults.applied(part.node, part.childclass))
            for part in _opened(node, childclass, document)
        ]
        self._carry(node, name, parent, compose(child.frame, read_pose(node, document.compiler)), parts)
        self._found.links.append(_link(node, name, parts, document))
        for part in parts:
            if part.node.tag == "site":
                self._add_site(part, name)
        for number, part in enumerate(parts):
            if part.node.tag == "body":
                self.read(part, name, f"{name}.body{number}")

    def _carry(self, node: Element, name: str, parent: str, pose: Pose, parts: list[_Child]) -> None:
        """Add the joints of body `name`, and the links between them."""
        joints = list(self._joints(name, parts))
        place, base = f"{node.file}:{node.line}", {}
        if parent == WORLD:
            standing = stand(node, name, pose, joints, self._base)
            if standing.joints:
                self._found.links.append(TreeLink(name=WORLD, place=place, virtual=True))
            self._found.standing.append(standing)
            below = standing.joints
            base = dict(zip(standing.planar, PLANAR_JOINTS, strict=False))
        else:
            below = tuple(chain(parent, name, pose, place, joints))
        for joint in below:
            self._found.joints.append(joint)
            if joint.child != name:
                self._found.links.append(TreeLink(name=joint.child, place=joint.place, virtual=True))
        for joint, _, _, start in joints:
            self._found.moved[joint.name] = Moved(base.get(joint.name, joint.name), joint, name)
            if start:
                self._found.start[joint.name] = start

    def _joints(self, body: str, parts: list[_Child]) -> Iterator[BodyJoint]:
        """Yield the joints of `body`; links between are named like them, or with the body's name before if taken."""
        parts = [part for part in parts if part.node.tag in {"joint", "freejoint"}]
        for number, part in enumerate(parts):
            name = _name(part.node, f"{body}.joint{number}" if len(parts) > 1 else f"{body}.joint")
            link = f"{body}.{name}" if name in self._taken else name
            yield read_joint(part.node, name, link, part.frame, self._document.compiler)

    def _add_site(self, part: _Child, body: str) -> None:
        name = part.node.attributes.get("name", "")
        if name in self._found.sites:
            first = self._found.sites[name].node.line
            part.node.error(f"site name {name!r} is taken already (line {first}): rename one")
        if name:
            pose = compose(part.frame, _site_pose(part.node, self._document))
            self._found.sites[name] = Site(part.node, body, pose)


def _opened(node: Element, childclass: str | None, document: Document, frame: Pose = Pose()) -> Iterator[_Child]:
    """Yield the children of a body, those inside a `<frame>` as if they stood outside."""
    for child in node.children():
        if child.tag == "frame":
            inner = child.attributes.get("childclass", childclass)
            document.defaults.check_class(child, inner)
            yield from _opened(child, inner, document, compose(frame, read_pose(child, document.compiler)))
        else:
            yield _Child(child, frame, childclass)


def _link(node: Element, name: str, parts: list[_Child], document: Document) -> TreeLink:
    read = [read_geom(part.node, part.frame, document) for part in parts if part.node.tag == "geom"]
    geoms = [geom for geom in read if geom]
    inertials = [part for part in parts if part.node.tag == "inertial"]
    for extra in inertials[1:]:
        extra.node.error(f"body {name!r} has more than one <inertial>: keep one")
    mode = document.compiler.inertia_from_geoms
    if inertials and mode is not True:
        properties = read_inertial(inertials[0].node, name, inertials[0].frame, document)
    else:
        properties = None if mode is False else from_geoms(geoms, document)
    return TreeLink(
        name=name,
        place=f"{node.file}:{node.line}",
        properties=properties,
        collisions=tuple(shape for geom in geoms if (shape := collision(geom, document))),
        visuals=tuple(look for geom in geoms if (look := visual(geom, document))),
    )


def _site_pose(node: Element, document: Document) -> Pose:
    if "fromto" not in node.attributes:
        return read_pose(node, document.compiler)
    ends = read_ends(node)
    return ends[0] if ends else Pose()


def _name(node: Element, default: str) -> str:
    name = node.attributes.get("name", "")
    if not name and node.tag != "freejoint":
        node.note(f"the <{node.tag}> without a name is called {default!r}")
    return name or default


def _refuse(node: Element, name: str) -> None:
    """Report what would make another robot if it were left out."""
    if node.number("gravcomp", 0.0) != 0.0:
        node.error(f"body {name!r}: gravcomp is not supported: remove it")
    if flag(node, "mocap", False):
        node.error(f"body {name!r}: a mocap body is no part of a robot: put it into the scene")


def _names(node: Element) -> Iterator[str]:
    """Yield the names of all bodies inside `node`."""
    for child in node.children():
        if child.tag == "body" and "name" in child.attributes:
            yield child.attributes["name"]
        if child.tag in {"body", "frame"}:
            yield from _names(child)
