"""Small robots built in code, whose motion is known on paper: for the conformance suite and for unit tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.inertia import as_vector, of_solids
from guard_api.model.robot import Actuator, Collision, Home, Joint, Link, RobotModel, Sensor
from guard_api.shapes import Box, Capsule, Matrix3, Pose, Shape, Sphere, Vector3

_TO_X = Pose(quaternion=(0.5**0.5, 0.0, 0.5**0.5, 0.0))
"""A frame whose z axis is the link's x axis: capsules lie along x."""


def pendulum(*, length: float = 1.0, mass: float = 1.0, damping: float = 0.0, armature: float = 0.0) -> RobotModel:
    """Return a rod with a heavy ball that swings about y, 2 m above the ground; it hangs down at joint position 0.

    The centre of mass is `length` [m] below the hinge; the inertia about it is that of a ball of radius 0.1 m.
    """
    ball = Collision(shape=Sphere(radius=0.1), pose=Pose(position=(0.0, 0.0, -length)))
    inertia = 0.4 * mass * 0.1**2
    bob = Link(
        name="bob",
        mass=mass,
        com=(0.0, 0.0, -length),
        inertia=_diagonal(inertia, inertia, inertia),
        collisions=(ball,),
    )
    hinge = _hinge("hinge", "mount", "bob", axis=(0.0, 1.0, 0.0), damping=damping, armature=armature)
    return _robot("pendulum", [_MOUNT, bob], [hinge], [_motor("hinge", 2.0)], height=2.0)


def double_pendulum() -> RobotModel:
    """Return two equal uniform rods of 0.5 m and 1 kg that swing about y, hanging from a height of 2 m."""
    rods = [_rod(name, 0.5, 1.0, down=True) for name in ("upper", "lower")]
    joints = [
        _hinge("shoulder", "mount", "upper", axis=(0.0, 1.0, 0.0)),
        _hinge("elbow", "upper", "lower", axis=(0.0, 1.0, 0.0), at=(0.0, 0.0, -0.5)),
    ]
    return _robot("double_pendulum", [_MOUNT, *rods], joints, [_motor("elbow", 2.0)], height=2.0)


def slider(*, limits: tuple[float, float] | None = (-1.0, 1.0)) -> RobotModel:
    """Return a cart of 1 kg on a rail along x, 1 m high, from which a free pole of 0.6 m and 0.5 kg hangs about y."""
    cart = Link(
        name="cart",
        mass=1.0,
        inertia=_box_inertia(1.0, (0.1, 0.1, 0.05)),
        collisions=(Collision(shape=Box(half_extents=(0.1, 0.1, 0.05))),),
    )
    rail = Joint(name="rail", kind="prismatic", parent="mount", child="cart", axis=(1.0, 0.0, 0.0), limits=limits)
    joints = [rail, _hinge("pole", "cart", "pole", axis=(0.0, 1.0, 0.0))]
    links = [_MOUNT, cart, _rod("pole", 0.6, 0.5, down=True)]
    return _robot("slider", links, joints, [_motor("rail", 5.0)], height=1.0)


def three_link_arm() -> RobotModel:
    """Return an arm of three capsules on a post, with a turned second joint, servos, damping, armature and a limit.

    One servo of each law: the base by velocity, the shoulder by position, the elbow by effort.
    """
    links = [_rod(name, 0.4, mass, down=False) for name, mass in (("turret", 2.0), ("upper", 1.0), ("fore", 0.5))]
    quarter = Pose(position=(0.4, 0.0, 0.0), quaternion=(0.5**0.5, 0.5**0.5, 0.0, 0.0))
    joints = [
        _hinge("base", "mount", "turret", axis=(0.0, 0.0, 1.0), damping=0.2, armature=0.05),
        Joint(
            name="shoulder", kind="revolute", parent="turret", child="upper", origin=quarter, axis=(0.0, 0.0, 1.0),
            limits=(-1.5, 1.5), damping=0.1, armature=0.02, effort_limit=20.0,
        ),
        _hinge("elbow", "upper", "fore", axis=(0.0, 0.6, 0.8), at=(0.4, 0.0, 0.0), damping=0.05, armature=0.01),
    ]  # fmt: skip
    actuators = [
        Actuator(name="base", law="velocity", joint="base", gear=2.0, kd=4.0, effort_limit=10.0),
        Actuator(name="shoulder", law="position", joint="shoulder", gear=1.0, kp=40.0, kd=2.0, effort_limit=30.0),
        _motor("elbow", 3.0),
    ]
    return _robot("three_link_arm", [_MOUNT, *links], joints, actuators, height=1.0)


def planar_point() -> RobotModel:
    """Return a ball of 1 kg, 0.1 m high, that slides along world x and y and turns about z, driven on all three."""
    inertia = 0.4 * 0.1**2
    ball = Link(
        name="robot",
        mass=1.0,
        inertia=_diagonal(inertia, inertia, inertia),
        collisions=(Collision(shape=Sphere(radius=0.1)),),
    )
    joints = [
        Joint(
            name="base_x", kind="prismatic", parent="world", child="base_x", axis=(1.0, 0.0, 0.0), damping=0.1,
            origin=Pose(position=(0.0, 0.0, 0.1)),
        ),
        Joint(name="base_y", kind="prismatic", parent="base_x", child="base_y", axis=(0.0, 1.0, 0.0), damping=0.1),
        _hinge("base_yaw", "base_y", "robot", axis=(0.0, 0.0, 1.0), damping=0.005),
    ]  # fmt: skip
    links = [Link(name="world", mass=0.0), Link(name="base_x", mass=0.0), Link(name="base_y", mass=0.0), ball]
    return RobotModel(
        name="planar_point",
        base="planar",
        root="robot",
        links=tuple(links),
        joints=tuple(joints),
        actuators=(_motor("base_x", 1.0), _motor("base_y", 1.0), _motor("base_yaw", 0.05)),
        sensors=(touch_sensor("robot"),),
        home=Home(height=0.1),
        collide_ground=False,
    )


def floating_body(*, thrusters: bool = True) -> RobotModel:
    """Return a free box of 1 kg and 0.2 x 0.4 x 0.6 m, centre of mass off its frame, two thrusters along its z."""
    half, com = (0.1, 0.2, 0.3), (0.02, -0.01, 0.03)
    body = Link(
        name="body",
        mass=1.0,
        com=com,
        inertia=_box_inertia(1.0, half),
        collisions=(Collision(shape=Box(half_extents=half), pose=Pose(position=com)),),
    )
    points = ((0.0, 0.2, 0.0), (0.0, -0.2, 0.0)) if thrusters else ()
    actuators = [
        Actuator(name=f"thruster{i}", law="thrust", link="body", point=point, gear=10.0, ctrl_range=(0.0, 1.0))
        for i, point in enumerate(points)
    ]
    return _robot("floating_body", [body], [], actuators, height=1.0, base="floating")


def floating_tree() -> RobotModel:
    """Return a free box with two arms of two rods each, hinged on different axes: six free and four joint axes."""
    body = Link(
        name="body",
        mass=2.0,
        com=(0.01, 0.0, 0.02),
        inertia=_box_inertia(2.0, (0.2, 0.1, 0.1)),
        collisions=(Collision(shape=Box(half_extents=(0.2, 0.1, 0.1))),),
    )
    links, joints = [body], []
    for side, y in (("left", 0.1), ("right", -0.1)):
        links += [_rod(f"{side}_upper", 0.3, 0.4, down=True), _rod(f"{side}_lower", 0.3, 0.2, down=True)]
        joints += [
            _hinge(f"{side}_hip", "body", f"{side}_upper", axis=(1.0, 0.0, 0.0), at=(0.0, y, 0.0), armature=0.01),
            _hinge(f"{side}_knee", f"{side}_upper", f"{side}_lower", axis=(0.0, 1.0, 0.0), at=(0.0, 0.0, -0.3)),
        ]
    actuators = [_motor(joint.name, 1.0) for joint in joints]
    return _robot("floating_tree", links, joints, actuators, height=1.0, base="floating")


ANT_LEG = 0.1 * 2**0.5
"""Length of the ant's shins, ankle to foot [m]; the feet are balls of 0.02 m about their ends."""


def ant(*, friction: float = 0.75, armature: float = 1.0, damping: float = 1.0, density: float = 5.0) -> RobotModel:
    """Return GUARD's ant: 13.6 g on four feet, moved by eight rotors of 1 kg m^2 that outweigh it a thousand times.

    The torso is 4.5 g with four legs of 0.6 g; on each hang a hip of 0.6 g and a shin of 1.1 g. The home pose stands
    on the four feet, ankles at 30 degrees: the torso's centre is 9 cm high.
    Source: the masses, places, ranges and gears of GUARD's ant.xml.
    """
    corners = [np.array([x, y, 0.0]) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    legs = [_capsule(0.05 * corner) for corner in corners]
    links = [_solid("torso", [(Sphere(radius=0.06), Pose()), *legs], density, friction)]
    joints = []
    for number, corner in enumerate(corners, start=1):
        hip, shin, place = f"hip_link_{number}", f"shin_{number}", as_vector(0.05 * corner)
        bend, up = as_vector(np.cross([0.0, 0.0, 1.0], corner) / 2**0.5), (0.0, 0.0, 1.0)
        links += [_solid(hip, [_capsule(0.05 * corner)], density, friction)]
        links += [_solid(shin, [_capsule(0.1 * corner)], density, friction)]
        for name, parent, child, axis, limits in (
            (f"hip_{number}", "torso", hip, up, (-30.0, 30.0)),
            (f"ankle_{number}", hip, shin, bend, (30.0, 70.0)),
        ):
            joints.append(
                Joint(
                    name=name, kind="revolute", parent=parent, child=child, origin=Pose(position=place), axis=axis,
                    limits=(np.deg2rad(limits[0]), np.deg2rad(limits[1])), armature=armature, damping=damping,
                )
            )  # fmt: skip
    motors = [_motor(joint.name, 30.0) for joint in joints]
    robot = _robot("ant", links, joints, motors, height=0.02 + ANT_LEG * 0.5, base="floating")
    home = {joint.name: np.deg2rad(30.0) for joint in joints if joint.name.startswith("ankle")}
    feet = tuple(sensor for sensor in robot.sensors if str(sensor.link).startswith("shin"))
    return replace(robot, home=replace(robot.home, joint_position=home), sensors=feet, timestep=0.02)


_MOUNT = Link(name="mount", mass=1.0, inertia=((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01)))


def _robot(
    name: str, links: Sequence[Link], joints: Sequence[Joint], actuators: Sequence[Actuator], *, height: float,
    base: str = "fixed",
) -> RobotModel:  # fmt: skip
    return RobotModel(
        name=name,
        base="floating" if base == "floating" else "fixed",
        root=links[0].name,
        links=tuple(links),
        joints=tuple(joints),
        actuators=tuple(actuators),
        sensors=tuple(touch_sensor(link.name) for link in links if link.collisions),
        home=Home(height=height),
    )


def _hinge(
    name: str, parent: str, child: str, *, axis: Vector3, at: Vector3 = (0.0, 0.0, 0.0), damping: float = 0.0,
    armature: float = 0.0,
) -> Joint:  # fmt: skip
    origin = Pose(position=at)
    return Joint(
        name=name, kind="continuous", parent=parent, child=child, origin=origin, axis=axis, damping=damping,
        armature=armature,
    )  # fmt: skip


def touch_sensor(
    link: str, *, place: Vector3 = (0.0, 0.0, 0.0), radius: float = float("inf"), name: str = "touch"
) -> Sensor:
    """Return a sensor of what touches `link` within `radius` [m] of `place` in its axes, or anywhere on it."""
    return Sensor(name=f"{name}_{link}", kind="touch", link=link, pose=Pose(position=place), radius=radius)


def _motor(joint: str, gear: float) -> Actuator:
    return Actuator(name=joint, law="effort", joint=joint, gear=gear)


def _rod(name: str, length: float, mass: float, *, down: bool) -> Link:
    """Return a uniform thin rod from the link's origin along x, or along -z if `down`; its capsule is 0.03 m thick."""
    across, along = mass * length**2 / 12.0, mass * 0.03**2 / 2.0
    capsule = Capsule(radius=0.03, half_length=length / 2 - 0.03)
    if down:
        com, inertia, turn = (0.0, 0.0, -length / 2), _diagonal(across, across, along), Pose()
    else:
        com, inertia, turn = (length / 2, 0.0, 0.0), _diagonal(along, across, across), _TO_X
    shape = Collision(shape=capsule, pose=Pose(position=com, quaternion=turn.quaternion))
    return Link(name=name, mass=mass, com=com, inertia=inertia, collisions=(shape,))


def _solid(name: str, shapes: list[tuple[Shape, Pose]], density: float, friction: float) -> Link:
    """Return a link that is `shapes` of uniform `density` [kg/m^3], which also touch things."""
    body = of_solids(shapes, density)
    collisions = tuple(Collision(shape=shape, pose=pose, friction=friction) for shape, pose in shapes)
    return Link(name=name, mass=body.mass, com=body.com, inertia=body.inertia, collisions=collisions)


def _capsule(end: NDArray[np.float64]) -> tuple[Shape, Pose]:
    """Return a capsule of radius 0.02 m whose axis runs from the origin to the horizontal `end` (3,), and its pose."""
    length = float(np.linalg.norm(end))
    w, x, y, z = rotations.from_axis_angle(np.cross([0.0, 0.0, 1.0], end) / length, np.array(np.pi / 2)).tolist()
    return Capsule(radius=0.02, half_length=length / 2), Pose(position=as_vector(end / 2), quaternion=(w, x, y, z))


def _diagonal(x: float, y: float, z: float) -> Matrix3:
    return ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))


def _box_inertia(mass: float, half: Vector3) -> Matrix3:
    x, y, z = (h * h for h in half)
    return _diagonal(mass * (y + z) / 3.0, mass * (x + z) / 3.0, mass * (x + y) / 3.0)
