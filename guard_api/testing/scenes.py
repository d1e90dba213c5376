"""Reference scenes of the conformance suite: small robots and bodies whose motion is known on paper."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guard_api import rotations
from guard_api.model.robot import Actuator, BaseKind, Collision, Joint, JointKind, Link, RobotModel, Sensor
from guard_api.physics.backend import Backend, World
from guard_api.physics.state import Start, State
from guard_api.scene.spec import BodyGroup, BodySpec, SceneSpec
from guard_api.scene.start import home_start
from guard_api.shapes import Box, Matrix3, Pose, Sphere, Vector3
from guard_api.testing.robots import touch_sensor

WEIGHTLESS: Vector3 = (0.0, 0.0, 0.0)
TIMESTEP = 0.002
RADIUS = 0.1


def diagonal(x: float, y: float, z: float) -> Matrix3:
    """Return the matrix diag(x, y, z)."""
    return ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))


def rest_start(scene: SceneSpec, num_worlds: int, **values: ArrayLike) -> Start:
    """Return the home start at rest, with `values` for single fields, broadcast over the worlds."""
    home = home_start(scene, num_worlds)
    given = {name: np.broadcast_to(value, getattr(home, name).shape).astype(float) for name, value in values.items()}
    return replace(home, **given)


@contextmanager
def running(backend: Backend, scene: SceneSpec, num_worlds: int = 1, **values: ArrayLike) -> Iterator[World]:
    """Build `num_worlds` of `scene`, start them from `rest_start` with `values`, close them at the end."""
    world = backend.build(scene, num_worlds)
    try:
        world.reset(np.ones(num_worlds, bool), rest_start(scene, num_worlds, **values))
        yield world
    finally:
        world.close()


def idle(world: World) -> NDArray[np.float64]:
    """Return the zero control of `world`: (N, U)."""
    robot = world.scene.robot
    return np.zeros((world.num_worlds, len(robot.actuators) if robot else 0))


def differing(a: State, b: State, names: tuple[str, ...] | None = None, worlds: Any = slice(None)) -> list[str]:
    """Return the names of the arrays of two states that differ in any bit, over the rows `worlds`."""
    names = names or tuple(item.name for item in fields(State))
    # Bytes, not ==: minus zero and NaN payloads count as bits too.
    return [n for n in names if getattr(a, n)[worlds].tobytes() != getattr(b, n)[worlds].tobytes()]


MOTION = ("time", "joint_position", "joint_velocity", "link_position", "link_quaternion", "link_linear_velocity",
          "link_angular_velocity", "body_position", "body_quaternion", "body_linear_velocity",
          "body_angular_velocity", "ok")  # fmt: skip
"""The fields of `State` that do not summarise the last step."""


def one_joint(
    kind: JointKind = "prismatic",
    *,
    axis: Vector3 = (1.0, 0.0, 0.0),
    mass: float = 2.0,
    com: Vector3 = (0.0, 0.0, 0.0),
    inertia: float = 0.05,
    actuators: tuple[Actuator, ...] = (),
    collisions: tuple[Collision, ...] = (),
    **joint: Any,
) -> RobotModel:
    """Return a welded root with one moving link: a slider or hinge about `axis`, `inertia` isotropic about the com.

    A link with collisions feels touch anywhere on it.
    """
    tip = Link(name="tip", mass=mass, com=com, inertia=diagonal(inertia, inertia, inertia), collisions=collisions)
    return RobotModel(
        name="one_joint",
        base="fixed",
        root="root",
        links=(Link(name="root", mass=1.0, inertia=diagonal(0.01, 0.01, 0.01)), tip),
        joints=(Joint(name="joint", kind=kind, parent="root", child="tip", axis=axis, **joint),),
        actuators=actuators,
        sensors=(touch_sensor("tip"),) if collisions else (),
    )


def pendulum(mass: float = 2.0, length: float = 0.5, inertia: float = 0.05) -> RobotModel:
    """Return a pendulum about y whose com hangs `length` below the joint at joint position 0."""
    return one_joint("continuous", axis=(0.0, 1.0, 0.0), mass=mass, com=(0.0, 0.0, -length), inertia=inertia)


def effort_actuator(joint: str = "joint", **values: Any) -> Actuator:
    """Return a direct drive of `joint` without a practical control limit."""
    return Actuator(**{"name": f"drive_{joint}", "law": "effort", "joint": joint, "ctrl_range": (-1e3, 1e3)} | values)


def loose_link(
    *,
    mass: float = 2.0,
    com: Vector3 = (0.0, 0.0, 0.0),
    inertia: float = 0.02,
    collisions: tuple[Collision, ...] = (),
    actuators: tuple[Actuator, ...] = (),
) -> RobotModel:
    """Return a floating robot of a single link, which feels touch anywhere if it has collisions."""
    hull = Link(name="hull", mass=mass, com=com, inertia=diagonal(inertia, inertia, inertia), collisions=collisions)
    return RobotModel(
        name="loose_link",
        base="floating",
        root="hull",
        links=(hull,),
        joints=(),
        actuators=actuators,
        sensors=(touch_sensor("hull"),) if collisions else (),
    )


def planar_ball(height: float) -> RobotModel:
    """Return a ball of `RADIUS` on a planar base, its centre `height` above the floor that it does not collide with."""
    links, joints = _planar_base("hull", height)
    hull = Link(name="hull", mass=2.0, inertia=diagonal(0.02, 0.02, 0.02), collisions=(ball(),))
    return RobotModel(
        name="planar_ball",
        base="planar",
        root="hull",
        links=(*links, hull),
        joints=tuple(joints),
        actuators=(),
        sensors=(touch_sensor("hull"),),
        collide_ground=False,
    )


def ball(friction: float = 1.0) -> Collision:
    """Return a sphere of `RADIUS` about the link frame."""
    return Collision(shape=Sphere(radius=RADIUS), friction=friction)


def cube(friction: float = 1.0) -> Collision:
    """Return a cube of half extent `RADIUS` about the link frame."""
    return Collision(shape=Box(half_extents=(RADIUS, RADIUS, RADIUS)), friction=friction)


def foot(height: float, actuators: tuple[Actuator, ...] = ()) -> RobotModel:
    """Return a ball on a vertical slider: at joint position 0 its centre is `height` above the root's frame."""
    origin = Pose(position=(0.0, 0.0, height))
    return one_joint(axis=(0.0, 0.0, 1.0), collisions=(ball(),), actuators=actuators, origin=origin)


def pusher(actuators: tuple[Actuator, ...] = (), *, friction: float = 1.0, **joint: Any) -> RobotModel:
    """Return a ball on a slider along x, half a metre above the floor: its centre is at (q, 0, 0.5)."""
    origin = Pose(position=(0.0, 0.0, 0.5))
    return one_joint(collisions=(ball(friction),), actuators=actuators, origin=origin, **joint)


def gantry(mass: float, collision: Collision) -> RobotModel:
    """Return a link of `mass` [kg] on a vertical slider that a cart carries along x, `RADIUS` above the floor."""
    lift = one_joint(axis=(0.0, 0.0, 1.0), mass=mass, com=(0.02, 0.0, -0.02), collisions=(collision,))
    cart = Link(name="cart", mass=1.0, inertia=diagonal(0.01, 0.01, 0.01))
    rail = Joint(
        name="rail", kind="prismatic", parent="root", child="cart", axis=(1.0, 0.0, 0.0),
        origin=Pose(position=(0.0, 0.0, RADIUS)),
    )  # fmt: skip
    root, tip = lift.links
    return replace(lift, links=(root, cart, tip), joints=(rail, replace(lift.joints[0], parent="cart")))


def with_sensors(robot: RobotModel, *sensors: Sensor) -> RobotModel:
    """Return `robot` with more sensors."""
    return replace(robot, sensors=(*robot.sensors, *sensors))


def body(physics: str = "dynamic", *, half: float = RADIUS, sphere: bool = False, **values: Any) -> BodySpec:
    """Return a cube of half extent `half`, or a sphere of that radius; 1 kg when dynamic."""
    shape = Sphere(radius=half) if sphere else Box(half_extents=(half, half, half))
    mass = 1.0 if physics == "dynamic" else 0.0
    return BodySpec(**{"shape": shape, "physics": physics, "mass": mass, "friction": 0.5} | values)


def bodies_scene(*groups: tuple[str, BodySpec, int], robot: RobotModel | None = None, **values: Any) -> SceneSpec:
    """Return a scene of `groups` (name, body, count)."""
    spec = tuple(BodyGroup(name=name, body=item, count=count) for name, item, count in groups)
    return SceneSpec(**{"robot": robot, "groups": spec, "timestep": TIMESTEP} | values)


def robot_scene(robot: RobotModel, **values: Any) -> SceneSpec:
    """Return a scene of `robot` alone, weightless and without a floor unless `values` say otherwise."""
    return SceneSpec(**{"robot": robot, "gravity": WEIGHTLESS, "ground": False, "timestep": TIMESTEP} | values)


def tree(base: BaseKind = "floating", *, actuators: bool = True, **joint: Any) -> RobotModel:
    """Return a branched robot that no engine keeps by luck.

    Links neither breadth- nor depth-first, names unsorted, every com off its frame, every inertia full, every joint
    frame turned, hinges and a slider mixed.
    """
    rng = np.random.default_rng(7)
    layout = [("trunk", "zeta"), ("zeta", "kappa"), ("trunk", "alpha"), ("kappa", "mu"), ("alpha", "beta")]
    kinds: list[JointKind] = ["revolute", "continuous", "prismatic", "revolute", "continuous"]
    links = [_odd_link("trunk", rng), *(_odd_link(child, rng) for _, child in layout)]
    joints = [_odd_joint(kind, *names, rng, joint) for kind, names in zip(kinds, layout, strict=True)]
    if base == "planar":
        base_links, base_joints = _planar_base("trunk", 0.5)
        links, joints = [*base_links, *links], [*base_joints, *joints]
    # Actuators in an order of their own: control columns are the actuators', not the joints'.
    order = [j for j in reversed(joints) if not j.name.startswith("base")]
    drives = tuple(effort_actuator(j.name) for j in order) if actuators else ()
    return RobotModel(
        name=f"tree_{base}", base=base, root="trunk",
        links=tuple(links), joints=tuple(joints), actuators=drives, collide_ground=base != "planar",
    )  # fmt: skip


def _odd_link(name: str, rng: np.random.Generator) -> Link:
    """Return a link with a com off its frame and a full inertia that a real solid could have."""
    quaternion = rng.normal(size=4)
    R = rotations.to_matrix(quaternion / np.linalg.norm(quaternion))
    second_moments = rng.uniform(0.002, 0.01, 3)  # of the mass distribution: any such triple is a real solid
    inertia = R @ np.diag(second_moments.sum() - second_moments) @ R.T
    inertia = (inertia + inertia.T) / 2
    x, y, z = (_vector(row) for row in inertia)
    com = _vector(rng.uniform(-0.1, 0.1, 3))
    return Link(name=name, mass=float(rng.uniform(0.5, 2.0)), com=com, inertia=(x, y, z))


def _odd_joint(kind: JointKind, parent: str, child: str, rng: np.random.Generator, values: dict[str, Any]) -> Joint:
    axis, quaternion = rng.normal(size=3), rng.normal(size=4)
    axis = _vector(axis / np.linalg.norm(axis))
    w, x, y, z = (quaternion / np.linalg.norm(quaternion)).tolist()
    origin = Pose(position=_vector(rng.uniform(-0.3, 0.3, 3)), quaternion=(w, x, y, z))
    name = f"{child}_joint"
    return Joint(name=name, kind=kind, parent=parent, child=child, origin=origin, axis=axis, **values)


def _vector(array: NDArray[np.float64]) -> Vector3:
    x, y, z = array.tolist()
    return (x, y, z)


def _planar_base(root: str, height: float) -> tuple[list[Link], list[Joint]]:
    """Return the three massless links and joints that carry `root` over the plane at `height`."""
    carriers = ["world_base", "base_x_link", "base_y_link"]
    joints = [
        Joint(name="base_x", kind="prismatic", parent=carriers[0], child=carriers[1], axis=(1.0, 0.0, 0.0),
              origin=Pose(position=(0.0, 0.0, height))),
        Joint(name="base_y", kind="prismatic", parent=carriers[1], child=carriers[2], axis=(0.0, 1.0, 0.0)),
        Joint(name="base_yaw", kind="continuous", parent=carriers[2], child=root),
    ]  # fmt: skip
    return [Link(name=name, mass=0.0) for name in carriers], joints
