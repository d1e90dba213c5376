"""The neutral robot: what every backend builds, and nothing an engine may reinterpret.

A `RobotModel` is a tree of links in which every link but the first hangs on exactly one one-degree-of-freedom
joint: `joints[i].child == links[i + 1].name`, parents before children. Fixed joints are merged by the readers.
A planar base is three ordinary joints (x, y, yaw) with massless links between them, so a backend needs only two
kinds of base: a root welded to the world and a root that floats.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from guard_api.shapes import Matrix3, Pose, Shape, Vector3

BaseKind: TypeAlias = Literal["fixed", "planar", "floating"]
JointKind: TypeAlias = Literal["revolute", "continuous", "prismatic"]
ActuatorLaw: TypeAlias = Literal["effort", "position", "velocity", "thrust"]
SensorKind: TypeAlias = Literal[
    "accelerometer", "velocimeter", "gyro", "magnetometer", "touch",
    "joint_position", "joint_velocity", "relative_rotation", "relative_angular_velocity",
]  # fmt: skip

PLANAR_JOINTS = ("base_x", "base_y", "base_yaw")
"""Names of the three joints of a planar base, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Collision:
    """A shape that touches things: `pose` in link axes, `friction` coefficient (see `guard_api.scene.spec`)."""

    shape: Shape
    pose: Pose = Pose()
    friction: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Visual:
    """A shape that is only looked at: `pose` in link axes, `rgba` in 0..1."""

    shape: Shape
    pose: Pose = Pose()
    rgba: tuple[float, float, float, float] = (1.0, 0.6, 0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A rigid body: `mass` [kg], `com` (3,) [m] in link axes, `inertia` (3, 3) [kg m^2] about the com in link axes.

    Massless links (mass 0) exist only between two joints, never at the end of a chain; `virtual` tells them.
    """

    name: str
    mass: float
    com: Vector3 = (0.0, 0.0, 0.0)
    inertia: Matrix3 = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    collisions: tuple[Collision, ...] = ()
    visuals: tuple[Visual, ...] = ()

    @property
    def virtual(self) -> bool:
        """Whether the link only carries a further joint and has no mass of its own."""
        return self.mass == 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A one-degree-of-freedom joint. Units are rad, N m, ... for revolute and continuous, m, N, ... for prismatic.

    origin: pose of the child's link frame in the parent's link axes at joint position 0.
    axis: unit (3,) in the child's link axes.
    limits: (lower, upper) position, or None for unlimited.
    damping: viscous [N m s/rad] or [N s/m], integrated implicitly (see `guard_api.physics.actuation`).
    friction_loss: dry friction [N m] or [N]. armature: rotor inertia felt by the joint alone [kg m^2] or [kg].
    stiffness: of a passive spring [N m/rad] or [N/m] that rests at `rest_position` [rad] or [m].
    effort_limit: bound on the sum of the actuator efforts on this joint; velocity_limit: informative only.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Pose = Pose()
    axis: Vector3 = (0.0, 0.0, 1.0)
    limits: tuple[float, float] | None = None
    damping: float = 0.0
    friction_loss: float = 0.0
    armature: float = 0.0
    stiffness: float = 0.0
    rest_position: float = 0.0
    effort_limit: float = float("inf")
    velocity_limit: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Actuator:
    """One control input. The formulas are in `guard_api.physics.actuation`.

    law: "effort", "position" or "velocity" act on `joint`; "thrust" is a force on `link` at `point` (3,) [m] along
    the unit `direction` (3,), both in link axes, turning with the link.
    gear: effort [N m or N], target [rad, m, rad/s, m/s] or force [N] per unit of control.
    ctrl_range: the control is clipped to it first; an action from -1 to 1 fills it.
    effort_limit: bound on the resulting effort or force.
    kp [N m/rad or N/m] and kd [N m s/rad or N s/m]: servo gains. offset: target, or thrust [N], at control 0.
    ceiling: height [m] of the link's origin above which a thrust loses its offset (GUARD's drone hovers below 3 m).
    """

    name: str
    law: ActuatorLaw
    joint: str | None = None
    link: str | None = None
    point: Vector3 = (0.0, 0.0, 0.0)
    direction: Vector3 = (0.0, 0.0, 1.0)
    gear: float = 1.0
    offset: float = 0.0
    ctrl_range: tuple[float, float] = (-1.0, 1.0)
    kp: float = 0.0
    kd: float = 0.0
    effort_limit: float = float("inf")
    ceiling: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A named place on the robot: `pose` in the axes of `link`; what a merged link leaves behind."""

    name: str
    link: str
    pose: Pose = Pose()


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """The straight piece of robot between two frames, `radius` [m] thick: what 3-D distances are measured from."""

    start: Frame
    end: Frame
    radius: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A reading in the observation: `kind` of quantity, of a place on `link` or of `joint`.

    accelerometer, velocimeter, gyro, magnetometer: at `pose` in the axes of `link`. touch: the force within `radius`
    [m] of `pose` (see `State.touch`). joint_position, joint_velocity: of `joint`. relative_rotation,
    relative_angular_velocity: of `link` in the axes of the link before it, past virtual links (a ball joint's reading).
    """

    name: str
    kind: SensorKind
    link: str | None = None
    joint: str | None = None
    pose: Pose = Pose()
    radius: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Home:
    """Where an episode starts: root link frame at `height` [m], joints (of the base excluded) at `joint_position`."""

    height: float = 0.0
    joint_position: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel:
    """A robot, complete: see the module docstring for the tree's invariants.

    root: the link whose frame is placed and starts at `home.height`.
    reference: the frame that is "where the robot is" for tasks and 2-D costs; None stands for the root link's.
    lidar: frames that carry a lidar and a compass each; empty stands for the reference alone.
    segments: what 3-D distances are measured from; empty stands for the reference as a point.
    keepout: radius kept free around the robot when a layout is sampled [m].
    spatial: whether it works in space: tasks and constraints take their 3-D forms. reach: the most distance of its
    reference from its base [m], for robots that stand in one place.
    timestep: physics step [s], the same in every engine. substeps: physics steps per environment step.
    collide_ground: False for planar robots of fixed height, which must not rub on the floor.
    notes: what the readers inferred, merged or ignored, one sentence each; shown by `guard robot check`.
    """

    name: str
    base: BaseKind
    root: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    reference: Frame | None = None
    lidar: tuple[Frame, ...] = ()
    segments: tuple[Segment, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    home: Home = field(default_factory=Home)
    keepout: float = 0.4
    spatial: bool = False
    reach: float = float("inf")
    timestep: float = 0.002
    substeps: int = 10
    collide_ground: bool = True
    licence: str = ""
    notes: tuple[str, ...] = ()

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links, in the order of `State.link_*`."""
        return tuple(link.name for link in self.links)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of `State.joint_*`."""
        return tuple(joint.name for joint in self.joints)

    @property
    def touch_sensors(self) -> tuple[Sensor, ...]:
        """Sensors of kind "touch", in the order of the columns of `State.touch`."""
        return tuple(sensor for sensor in self.sensors if sensor.kind == "touch")

    @property
    def floating(self) -> bool:
        """Whether the first link moves freely; otherwise it is welded to the world where the episode starts."""
        return self.base == "floating"

    def link_index(self, name: str) -> int:
        """Return the position of link `name` in `links`. Raises ValueError when there is none."""
        return self.link_names.index(name)

    def joint_index(self, name: str) -> int:
        """Return the position of joint `name` in `joints`. Raises ValueError when there is none."""
        return self.joint_names.index(name)
