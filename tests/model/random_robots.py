"""Random robots for property tests: any tree of bodies that the neutral model allows."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st

from guard_api import rotations
from guard_api.model.base import with_base
from guard_api.model.inertia import MassProperties, as_matrix, as_vector
from guard_api.model.robot import Actuator, Collision, Frame, Home, Joint, Link, RobotModel, Segment, Sensor, Visual
from guard_api.model.sidefile import SideFile
from guard_api.shapes import Box, Capsule, Cylinder, Pose, Sphere

lengths = st.floats(0.01, 2.0)
positions = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
fractions = st.floats(0.0, 1.0)
names = st.text("abcxyz_é<&\"'.", min_size=1, max_size=6)


@st.composite
def quaternions(draw) -> tuple[float, float, float, float]:
    """Attitudes, the ones at and near gimbal lock among them."""
    if draw(st.booleans()):
        half_turns = st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0])
        angles = [draw(half_turns) * math.pi + draw(st.sampled_from([0.0, 1e-9, -1e-7, 1e-15])) for _ in range(3)]
    else:
        angles = [draw(st.floats(-math.pi, math.pi)) for _ in range(3)]
    q = rotations.from_rpy(*angles)
    q /= np.linalg.norm(q)
    w, x, y, z = (float(value) for value in (-q if q[0] < 0 else q))
    return w, x, y, z


@st.composite
def poses(draw) -> Pose:
    return Pose(position=draw(positions), quaternion=draw(quaternions()))


@st.composite
def axes(draw) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in rotations.rotate(draw(quaternions()), (0.0, 0.0, 1.0)))
    norm = math.hypot(x, y, z)
    return x / norm, y / norm, z / norm


shapes = st.one_of(
    st.builds(Sphere, radius=lengths),
    st.builds(Box, half_extents=st.tuples(lengths, lengths, lengths)),
    st.builds(Cylinder, radius=lengths, half_length=lengths),
    st.builds(Capsule, radius=lengths, half_length=lengths),
)


@st.composite
def mass_properties(draw) -> MassProperties:
    """Those of a few point masses off one line: physically possible by construction."""
    mass = draw(st.floats(0.01, 50.0))
    second = np.array([draw(st.floats(0.001, 1.0)) for _ in range(3)]) * mass
    R = rotations.to_matrix(draw(quaternions()))
    inertia = R @ np.diag(second.sum() - second) @ R.T
    return MassProperties(mass=mass, com=draw(positions), inertia=as_matrix(0.5 * (inertia + inertia.T)))


@st.composite
def links(draw, name: str, massless: bool) -> Link:
    if massless:
        return Link(name=name, mass=0.0)
    properties = draw(mass_properties())
    collisions = st.builds(Collision, shape=shapes, pose=poses(), friction=st.floats(0.0, 3.0))
    visuals = st.builds(Visual, shape=shapes, pose=poses(), rgba=st.tuples(*[fractions] * 4))
    return Link(
        name=name,
        mass=properties.mass,
        com=properties.com,
        inertia=properties.inertia,
        collisions=tuple(draw(st.lists(collisions, max_size=2))),
        visuals=tuple(draw(st.lists(visuals, max_size=1))),
    )


@st.composite
def joints(draw, name: str, parent: str, child: str) -> Joint:
    kind = draw(st.sampled_from(["revolute", "continuous", "prismatic"]))
    lower = draw(st.floats(-3.0, 3.0))
    bounds = st.one_of(st.just(math.inf), st.floats(0.1, 1e4))
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        origin=draw(poses()),
        axis=draw(axes()),
        limits=None if kind == "continuous" else (lower, lower + draw(st.floats(0.01, 3.0))),
        damping=draw(st.floats(0.0, 10.0)),
        friction_loss=draw(st.floats(0.0, 10.0)),
        armature=draw(st.floats(0.0, 10.0)),
        stiffness=draw(st.floats(0.0, 10.0)),
        rest_position=draw(st.floats(-3.0, 3.0)),
        effort_limit=draw(bounds),
        velocity_limit=draw(bounds),
    )


@st.composite
def actuators(draw, name: str, joint_names: list[str], link_names: list[str]) -> Actuator:
    law = draw(st.sampled_from(["effort", "position", "velocity", "thrust"] if joint_names else ["thrust"]))
    shared = {
        "name": name,
        "gear": draw(st.floats(0.1, 10.0)),
        "ctrl_range": (draw(st.floats(-2.0, 0.0)), draw(st.floats(0.1, 2.0))),
        "effort_limit": draw(st.one_of(st.just(math.inf), st.floats(0.1, 100.0))),
    }
    if law == "thrust":
        place = {"link": draw(st.sampled_from(link_names)), "point": draw(positions), "direction": draw(axes())}
        hover = {"offset": draw(st.floats(-1.0, 1.0)), "ceiling": draw(st.one_of(st.just(math.inf), lengths))}
        return Actuator(law=law, **place, **hover, **shared)
    servo = law != "effort"
    return Actuator(
        law=law,
        joint=draw(st.sampled_from(joint_names)),
        kp=draw(st.floats(0.1, 10.0)) if law == "position" else 0.0,
        kd=draw(st.floats(0.1, 10.0)) if servo else 0.0,
        offset=draw(st.floats(-1.0, 1.0)) if servo else 0.0,
        **shared,
    )


@st.composite
def sensors(draw, name: str, joint_names: list[str], link_names: list[str]) -> Sensor:
    """Any sensor but a second one on the whole of a link; only links after the first turn against another."""
    kinds = ["accelerometer", "velocimeter", "gyro", "magnetometer", "touch"]
    of_joints = ["joint_position", "joint_velocity", "relative_rotation", "relative_angular_velocity"]
    kind = draw(st.sampled_from(kinds + of_joints if joint_names else kinds))
    if kind.startswith("joint"):
        return Sensor(name=name, kind=kind, joint=draw(st.sampled_from(joint_names)))
    if kind.startswith("relative"):
        return Sensor(name=name, kind=kind, link=draw(st.sampled_from(link_names[1:])))
    link = draw(st.sampled_from(link_names))
    if kind == "touch":
        return Sensor(name=name, kind=kind, link=link, pose=Pose(position=draw(positions)), radius=draw(lengths))
    return Sensor(name=name, kind=kind, link=link, pose=draw(poses()))


@st.composite
def frames(draw, link_names: list[str]) -> list[Frame]:
    """A link's own frame, and frames of other names."""
    others = draw(_few(names.filter(lambda name: name not in link_names)))
    own = draw(st.sampled_from(link_names))
    places = [Frame(name=name, link=draw(st.sampled_from(link_names)), pose=draw(poses())) for name in others]
    return [Frame(name=own, link=own), *places]


@st.composite
def robots(draw) -> RobotModel:
    """Whole robots, links depth first; a link in mid-chain may be massless."""
    base = draw(st.sampled_from(["fixed", "planar", "floating"]))
    link_names = draw(st.lists(names, min_size=1, max_size=5, unique=True))
    joint_names = draw(st.lists(names, min_size=len(link_names) - 1, max_size=len(link_names) - 1, unique=True))
    # Hanging each link on one of the chain to its predecessor is what makes the order depth first.
    parents, chain = [], [0]
    for i in range(1, len(link_names)):
        chain = chain[: draw(st.integers(1, len(chain)))]
        parents.append(chain[-1])
        chain.append(i)
    carriers = {parent for parent in parents if base == "fixed" or parent > 0}
    massless = [i in carriers and draw(st.booleans()) for i in range(len(link_names))]
    places = st.sampled_from(draw(frames(link_names)))
    sensor_list = [draw(sensors(name, joint_names, link_names)) for name in draw(_few(names))]
    if draw(st.booleans()):
        sensor_list.append(Sensor(name="whole", kind="touch", link=draw(st.sampled_from(link_names))))
    model = RobotModel(
        name=draw(names),
        base=base,
        root=link_names[0],
        links=tuple(draw(links(name, empty)) for name, empty in zip(link_names, massless, strict=True)),
        joints=tuple(
            draw(joints(name, link_names[parent], link_names[i + 1]))
            for i, (name, parent) in enumerate(zip(joint_names, parents, strict=True))
        ),
        actuators=tuple(draw(actuators(name, joint_names, link_names)) for name in draw(_few(names))),
        reference=draw(st.one_of(st.none(), places)),
        lidar=tuple(draw(st.lists(places, max_size=2, unique=True))),
        segments=tuple(draw(st.lists(st.builds(Segment, start=places, end=places, radius=fractions), max_size=2))),
        sensors=tuple(sensor_list),
        home=Home(
            height=draw(fractions), joint_position={name: draw(st.floats(-1.0, 1.0)) for name in joint_names[::2]}
        ),
        keepout=draw(lengths),
        timestep=draw(st.floats(1e-4, 0.02)),
        substeps=draw(st.integers(1, 20)),
        collide_ground=draw(st.booleans()),
        licence=draw(st.sampled_from(["", "CC0-1.0"])),
    )
    base_joints = ("base_damping", "base_armature", "base_stiffness", "base_rest_position")
    triples = {name: as_vector([draw(fractions) for _ in range(3)]) for name in base_joints}
    return with_base(model, SideFile(**triples))


def _few(elements: st.SearchStrategy[str]) -> st.SearchStrategy[list[str]]:
    return st.lists(elements, max_size=2, unique=True)
