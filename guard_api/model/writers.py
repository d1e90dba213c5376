"""Writes a robot as the two files that `guard_api.model.reader` reads back to the same model.

Links and joints keep their order if it is depth first, as the readers leave it; `notes` and mesh sources are not kept.
A named frame is written as an empty link on a fixed joint, which the readers merge into its link again.
Numbers are written so that they read back to the same bits. A planar base is written as `[base]` in the side file,
never as links and joints, because it is a way to stand in the world and no part of the robot.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from guard_api import rotations
from guard_api.errors import ModelError
from guard_api.model.base import without_base
from guard_api.model.robot import Actuator, Collision, Frame, Joint, Link, RobotModel, Sensor, Visual
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Pose, Quaternion, Shape, Sphere


def to_urdf(model: RobotModel) -> str:
    """Return `model` as URDF text; a mesh refers to the file name that `mesh_files` gives its hull.

    Raises ModelError for a revolute or prismatic joint without limits and for two places of one name, which URDF
    cannot express.
    """
    links, joints = without_base(model)
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(model.name)}>"]
    for link in links:
        lines += _link(link)
    for joint in joints:
        lines += _joint(joint)
    taken = {joint.name for joint in joints}
    for frame in _frames(model):
        lines += _frame(frame, _free_name(frame.name, taken))
    return "\n".join([*lines, "</robot>", ""])


def to_side_file(model: RobotModel) -> str:
    """Return the `robot.toml` text that completes `to_urdf(model)`."""
    _, joints = without_base(model)
    lines = [
        f"licence = {_toml(model.licence)}",
        f"keepout = {_toml(model.keepout)}",
        f"spatial = {_toml(model.spatial)}",
        *([f"reach = {_toml(model.reach)}"] if math.isfinite(model.reach) else []),
        f"timestep = {_toml(model.timestep)}",
        f"substeps = {model.substeps}",
        f"collide_ground = {_toml(model.collide_ground)}",
        *([f"reference = {_toml(model.reference.name)}"] if model.reference else []),
        f"lidar = {_toml([frame.name for frame in model.lidar])}",
        *_table("base", _base(model)),
        *_table("home", {"height": model.home.height}),
        *_table("home.joints", model.home.joint_position),
        *_table("friction", {name: shape.friction for name, shape in _named_collisions(model)}),
        *_table("armature", {joint.name: joint.armature for joint in joints}),
        *_table("stiffness", {joint.name: joint.stiffness for joint in joints}),
        *_table("rest_position", {joint.name: joint.rest_position for joint in joints}),
    ]
    for actuator in model.actuators:
        lines += _table("[actuators]", _actuator(actuator))
    for sensor in model.sensors:
        lines += _table("[sensors]", _sensor(sensor))
    for segment in model.segments:
        ends = {"start": segment.start.name, "end": segment.end.name}
        lines += _table("[segments]", {**ends, "radius": segment.radius})
    return "\n".join([*lines, ""])


def mesh_files(model: RobotModel) -> dict[str, str]:
    """Return the Wavefront OBJ text of every hull of `model`, by the file name that `to_urdf` gives it."""
    files: dict[str, str] = {}
    for link in model.links:
        for part in (*link.collisions, *link.visuals):
            if isinstance(part.shape, Mesh):
                files[_mesh_name(part.shape)] = _obj(part.shape)
    return files


def rpy(quaternion: Quaternion) -> tuple[float, float, float]:
    """Return URDF's roll, pitch, yaw [rad] of a unit `quaternion`, exact to rounding at every attitude.

    At pitch +-90 degrees only one combination of roll and yaw is determined; the roll is then taken from what remains
    after yaw is undone, so that no error of yaw survives.
    """
    R = rotations.to_matrix(quaternion)
    yaw = math.atan2(R[1, 0], R[0, 0])
    rest = rotations.to_matrix(rotations.yaw_quaternion(-yaw)) @ R
    return math.atan2(-rest[1, 2], rest[1, 1]), math.atan2(-rest[2, 0], rest[0, 0]), yaw


def _link(link: Link) -> Iterator[str]:
    yield f"  <link name={quoteattr(link.name)}>"
    if link.mass > 0.0:
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertia
        yield "    <inertial>"
        yield f'      <origin xyz="{_numbers(link.com)}"/>'
        yield f'      <mass value="{_numbers([link.mass])}"/>'
        yield f'      <inertia ixx="{xx!r}" ixy="{xy!r}" ixz="{xz!r}" iyy="{yy!r}" iyz="{yz!r}" izz="{zz!r}"/>'
        yield "    </inertial>"
    for i, collision in enumerate(link.collisions):
        yield f"    <collision name={quoteattr(_collision_name(link, i))}>"
        yield from _placed(collision)
        yield "    </collision>"
    for visual in link.visuals:
        yield "    <visual>"
        yield from _placed(visual)
        yield f'      <material name=""><color rgba="{_numbers(visual.rgba)}"/></material>'
        yield "    </visual>"
    yield "  </link>"


def _placed(part: Collision | Visual) -> Iterator[str]:
    yield f"      {_origin(part.pose)}"
    yield f"      <geometry>{_shape(part.shape)}</geometry>"


def _shape(shape: Shape) -> str:
    match shape:
        case Sphere(radius=radius):
            return f'<sphere radius="{radius!r}"/>'
        case Box(half_extents=(x, y, z)):
            return f'<box size="{_numbers((2.0 * x, 2.0 * y, 2.0 * z))}"/>'
        case Cylinder(radius=radius, half_length=half):
            return f'<cylinder radius="{radius!r}" length="{2.0 * half!r}"/>'
        case Capsule(radius=radius, half_length=half):
            return f'<capsule radius="{radius!r}" length="{2.0 * half!r}"/>'
        case Mesh():
            return f'<mesh filename="{_mesh_name(shape)}"/>'


def _joint(joint: Joint) -> Iterator[str]:
    if joint.kind != "continuous" and joint.limits is None:
        raise ModelError(f"joint {joint.name!r}: URDF has no {joint.kind} joint without limits: give it limits")
    yield f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">'
    yield f"    <parent link={quoteattr(joint.parent)}/>"
    yield f"    <child link={quoteattr(joint.child)}/>"
    yield f"    {_origin(joint.origin)}"
    yield f'    <axis xyz="{_numbers(joint.axis)}"/>'
    bounds = dict(zip(("lower", "upper"), joint.limits or (), strict=False))
    bounds |= _finite({"effort": joint.effort_limit, "velocity": joint.velocity_limit})
    attributes = "".join(f' {name}="{value!r}"' for name, value in bounds.items())
    if attributes:
        yield f"    <limit{attributes}/>"
    yield f'    <dynamics damping="{joint.damping!r}" friction="{joint.friction_loss!r}"/>'
    yield "  </joint>"


def _frames(model: RobotModel) -> list[Frame]:
    """Return the frames that are no link's own, each once, in the order of their first use."""
    named = [
        model.reference,
        *model.lidar,
        *(end for segment in model.segments for end in (segment.start, segment.end)),
    ]
    places = {link.name: Frame(name=link.name, link=link.name) for link in model.links}
    found: list[Frame] = []
    for frame in named:
        if frame and frame.name not in places:
            places[frame.name] = frame
            found.append(frame)
        elif frame and places[frame.name] != frame:
            raise ModelError(
                f"frame {frame.name!r} on link {frame.link!r}: the name belongs to another place: rename it"
            )
    return found


def _frame(frame: Frame, joint_name: str) -> Iterator[str]:
    yield f"  <link name={quoteattr(frame.name)}/>"
    yield f'  <joint name={quoteattr(joint_name)} type="fixed">'
    yield f"    <parent link={quoteattr(frame.link)}/>"
    yield f"    <child link={quoteattr(frame.name)}/>"
    yield f"    {_origin(frame.pose)}"
    yield "  </joint>"


def _free_name(name: str, taken: set[str]) -> str:
    """Return `name`, lengthened until it is not in `taken`, to which it is then added."""
    while name in taken:
        name += "_frame"
    taken.add(name)
    return name


def _origin(pose: Pose) -> str:
    return f'<origin xyz="{_numbers(pose.position)}" rpy="{_numbers(rpy(pose.quaternion))}"/>'


def _base(model: RobotModel) -> dict[str, object]:
    if model.base != "planar":
        return {"kind": model.base}
    joints = model.joints[:3]
    return {
        "kind": model.base,
        "damping": [joint.damping for joint in joints],
        "armature": [joint.armature for joint in joints],
        "stiffness": [joint.stiffness for joint in joints],
        "rest_position": [joint.rest_position for joint in joints],
    }


def _actuator(actuator: Actuator) -> dict[str, object]:
    entry: dict[str, object] = {"name": actuator.name, "law": actuator.law}
    if actuator.law == "thrust":
        entry |= {"link": actuator.link, "point": actuator.point, "direction": actuator.direction}
    else:
        entry["joint"] = actuator.joint
    entry |= {"gear": actuator.gear, "ctrl_range": actuator.ctrl_range}
    if actuator.law == "position":
        entry["kp"] = actuator.kp
    if actuator.law in {"position", "velocity"}:
        entry["kd"] = actuator.kd
    if actuator.law != "effort":
        entry["offset"] = actuator.offset
    bounds = {"effort_limit": actuator.effort_limit, "ceiling": actuator.ceiling}
    return entry | _finite(bounds)


def _sensor(sensor: Sensor) -> dict[str, object]:
    entry: dict[str, object] = {"name": sensor.name, "kind": sensor.kind}
    match sensor.kind:
        case "joint_position" | "joint_velocity":
            return entry | {"joint": sensor.joint}
        case "relative_rotation" | "relative_angular_velocity":
            return entry | {"link": sensor.link}
        case "touch":
            return entry | {"link": sensor.link, "position": sensor.pose.position} | _finite({"radius": sensor.radius})
    pose = {"position": sensor.pose.position, "rpy": rpy(sensor.pose.quaternion)}
    return entry | {"link": sensor.link, **pose}


def _named_collisions(model: RobotModel) -> Iterator[tuple[str, Collision]]:
    for link in model.links:
        for i, collision in enumerate(link.collisions):
            yield _collision_name(link, i), collision


def _collision_name(link: Link, index: int) -> str:
    return f"{link.name}.{index}"


def _finite(bounds: dict[str, float]) -> dict[str, float]:
    """Return the bounds that bind."""
    return {name: value for name, value in bounds.items() if math.isfinite(value)}


def _table(name: str, entries: dict[str, object] | dict[str, float]) -> list[str]:
    return ["", f"[{name}]", *(f"{_toml(key)} = {_toml(value)}" for key, value in entries.items())]


def _toml(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case float() | int():
            return repr(float(value))
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case list() | tuple():
            return f"[{', '.join(_toml(item) for item in value)}]"
    raise TypeError(f"no TOML for {value!r}")


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _mesh_name(mesh: Mesh) -> str:
    """Return a file name that follows from the hull's corners, so that equal hulls share a file."""
    return f"hull_{hashlib.sha256(repr(mesh.vertices).encode()).hexdigest()[:12]}.obj"


def _obj(mesh: Mesh) -> str:
    from scipy.spatial import ConvexHull  # noqa: PLC0415  slow to import, needed for meshes only

    corners = [f"v {_numbers(vertex)}" for vertex in mesh.vertices]
    faces = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in ConvexHull(np.asarray(mesh.vertices)).simplices]
    return "\n".join([*corners, *faces, ""])
