"""Mass properties of a body: its `<inertial>`, or those of its geoms."""

from __future__ import annotations

from collections.abc import Sequence

from guard_api.model.element import Element
from guard_api.model.inertia import UNIT_INERTIA, MassProperties, combined, impossibility, moved
from guard_api.model.merge import compose
from guard_api.model.mjcf.document import Document
from guard_api.model.mjcf.geoms import Geom, mass_properties
from guard_api.model.mjcf.placement import ORIENTATIONS, read_pose
from guard_api.shapes import ORIGIN, Matrix3, Pose


def read_inertial(node: Element, body: str, frame: Pose, document: Document) -> MassProperties:
    """Return the `<inertial>` of `body`, inside `frame`, in body axes."""
    if "pos" not in node.attributes:
        node.error(f"body {body!r}: <inertial> has no pos: add pos=...")
    mass = node.number("mass")
    if mass <= 0.0:
        node.error(f"body {body!r}: mass {mass:g} kg must be positive; a body without mass has no <inertial>")
        mass = 1.0
    inertia = _inertia(node)
    reason = impossibility(inertia)
    if reason:
        node.error(f"body {body!r}: no rigid body has this inertia: {reason}")
        inertia = UNIT_INERTIA
    part = MassProperties(mass=mass, com=ORIGIN, inertia=inertia)
    return moved(part, compose(frame, read_pose(node, document.compiler)))


def from_geoms(geoms: Sequence[Geom], document: Document) -> MassProperties | None:
    """Return the geoms as one body, overlaps counted twice as in MuJoCo; None if none has mass."""
    parts = [part for geom in geoms if (part := mass_properties(geom, document))]
    return combined(parts) if parts else None


def _inertia(node: Element) -> Matrix3:
    if "fullinertia" not in node.attributes:
        x, y, z = node.vector("diaginertia", 3)
        return (x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)
    for name in ("diaginertia", *ORIENTATIONS):
        if name in node.attributes:
            node.error(f"<inertial> has both fullinertia and {name}: keep one")
    xx, yy, zz, xy, xz, yz = node.vector("fullinertia", 6, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
