"""Reads `robot.toml`: what a robot file cannot say.

Every key, with its default or an example:

    licence = ""               # SPDX expression, such as "CC0-1.0"
    keepout = 0.4              # radius kept free around the robot in layouts [m]
    spatial = false            # whether it works in space: tasks and constraints take their 3-D forms
    reach = 2.0                # most distance of its reference from its base [m]; unlimited when left out
    timestep = 0.002           # physics step [s], the same in every engine
    substeps = 10              # physics steps per environment step
    collide_ground = true      # false by default for a planar base, whose height is fixed
    density = 1000.0           # [kg/m^3] for links without <inertial>; no default: nothing is invented
    reference = "hand"         # link whose frame is where the robot is for tasks; the root link when left out
    lidar = ["hand", "elbow"]  # links that carry a lidar and a compass each; the reference when left out

    [base]
    kind = "fixed"             # "fixed", "planar" (x, y and heading) or "floating"
    damping = [0, 0, 0]        # planar only: of base_x, base_y [N s/m] and base_yaw [N m s/rad]
    armature = [0, 0, 0]       # planar only: [kg], [kg], [kg m^2]
    stiffness = [0, 0, 0]      # planar only: of springs [N/m], [N/m], [N m/rad]
    rest_position = [0, 0, 0]  # planar only: where they rest [m], [m], [rad], in the world: not where an episode starts

    [home]
    height = 0.0               # of the root link's frame where an episode starts [m]
    joints = { hip = 0.3 }     # positions there [rad or m]; 0 for those left out; outside the limits is noted

    [friction]                 # friction coefficients, by the name of a link or of a <collision>
    default = 1.0
    foot = 2.0

    [armature]                 # rotor inertia, by joint [kg m^2 or kg]; default: what the robot file says
    default = 0.0
    hip = 0.01
    [damping]                  # by joint [N m s/rad or N s/m], likewise; replaces the robot file's
    [stiffness]                # of a spring, by joint [N m/rad or N/m], likewise
    [rest_position]            # where it rests, by joint [rad or m], likewise

    [[actuators]]              # in the order of the action
    name = "hip"
    law = "effort"             # "effort", "position", "velocity" or "thrust": `guard_api.physics.actuation`
    joint = "hip"              # for thrust instead: link, direction = [x, y, z] and point = [0, 0, 0] in its axes
    gear = 1.0
    ctrl_range = [-1.0, 1.0]   # of the control, which is clipped to it; an action from -1 to 1 fills it
    effort_limit = 5.0         # [N m or N]; unlimited when left out
    kp = 1.0                   # position only
    kd = 0.1                   # position (default 0) and velocity
    offset = 0.0               # position and velocity: target at control 0; thrust: force at control 0 [N]
    ceiling = 3.0              # thrust only: height above which the offset is lost [m]; none when left out

    [[sensors]]                # in the order of the model
    kind = "gyro"              # "accelerometer", "velocimeter", "gyro" or "magnetometer"
    link = "torso"
    name = "gyro"              # default: the kind
    position = [0, 0, 0]       # [m], in the link's axes
    rpy = [0, 0, 0]            # [rad]
    [[sensors]]
    kind = "touch"
    link = "foot"
    name = "touch_foot"        # default: touch_ and the link
    position = [0, 0, 0]       # [m], in the link's axes
    radius = 0.05              # contacts counted: those this near [m]; all of the link when left out
    [[sensors]]
    kind = "joint_position"    # or "joint_velocity"
    joint = "hip"              # base_x, base_y, base_yaw of a planar base too
    name = "jointpos_hip"      # default: jointpos_ or jointvel_ and the joint
    [[sensors]]
    kind = "relative_rotation" # or "relative_angular_velocity": of the link in the axes of the one before it
    link = "thigh"             # the child of a ball joint, say
    name = "ballquat_thigh"    # default: ballquat_ or ballangvel_ and the link

    [[segments]]               # what 3-D distances are measured from; the reference as a point when there are none
    start = "elbow"            # links: from frame origin to frame origin
    end = "hand"
    radius = 0.0               # thickness [m]

All names are those of the robot file; what sits on a link that is merged into another moves along with it. A ball
joint's hinges are named `<joint>_x`, `<joint>_y`, `<joint>_z`; armature, damping and stiffness of all three can be
given by the ball's own name.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast, get_args

from guard_api.model.entries import read_actuator, read_segment, read_sensor
from guard_api.model.inertia import as_vector
from guard_api.model.problems import Problems
from guard_api.model.robot import Actuator, BaseKind, Frame, Segment, Sensor
from guard_api.model.toml_table import Table
from guard_api.shapes import ORIGIN, Vector3

DEFAULT = "default"
"""The key of `[friction]`, `[armature]` and the like for everything that is not named there."""

LEAST_DENSITY = 1e-9
"""Density [kg/m^3] below which masses of small shapes would vanish in rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SideFile:
    """The contents of a `robot.toml`; None where a default depends on the robot.

    Links and joints are as named there: not checked yet, and a link may still be merged into another.
    given: the keys that the file holds, those of `base` after a dot, which override what a robot file says.
    """

    place: str = "robot.toml"
    given: frozenset[str] = frozenset()
    licence: str = ""
    keepout: float = 0.4
    spatial: bool = False
    reach: float = math.inf
    timestep: float = 0.002
    substeps: int = 10
    collide_ground: bool | None = None
    density: float | None = None
    reference: Frame | None = None
    lidar: tuple[Frame, ...] = ()
    segments: tuple[Segment, ...] = ()
    base: BaseKind | None = None
    base_damping: Vector3 = ORIGIN
    base_armature: Vector3 = ORIGIN
    base_stiffness: Vector3 = ORIGIN
    base_rest_position: Vector3 = ORIGIN
    height: float | None = None
    joint_position: dict[str, float] = field(default_factory=dict)
    friction: dict[str, float] = field(default_factory=dict)
    armature: dict[str, float] = field(default_factory=dict)
    damping: dict[str, float] = field(default_factory=dict)
    stiffness: dict[str, float] = field(default_factory=dict)
    rest_position: dict[str, float] = field(default_factory=dict)
    actuators: tuple[Actuator, ...] = ()
    sensors: tuple[Sensor, ...] = ()


def read_side_file(path: Path, problems: Problems) -> SideFile:
    """Return the side file at `path`; faults go to `problems` and stand-ins take their places."""
    try:
        data = tomllib.loads(path.read_bytes().decode())
    except OSError as error:
        problems.error(str(path), f"cannot be read: {error.strerror}")
        return SideFile(place=str(path))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        problems.error(str(path), f"malformed TOML: {error}")
        return SideFile(place=str(path))
    top = Table(data, str(path), problems)
    base, home = top.table("base"), top.table("home")
    kind = cast(BaseKind, base.text("kind", choices=get_args(BaseKind))) if "kind" in base else None
    damping, armature, stiffness = (_triple(base, key, kind) for key in ("damping", "armature", "stiffness"))
    result = SideFile(
        place=str(path),
        given=frozenset(data) | {f"base.{key}" for key in base},
        licence=top.text("licence", ""),
        keepout=top.number("keepout", 0.4, above=0.0),
        spatial=top.boolean("spatial", False),
        reach=top.number("reach", above=0.0) if "reach" in top else math.inf,
        timestep=top.number("timestep", 0.002, above=0.0),
        substeps=top.integer("substeps", 10, at_least=1),
        collide_ground=top.boolean("collide_ground", True) if "collide_ground" in top else None,
        density=top.number("density", above=LEAST_DENSITY) if "density" in top else None,
        reference=_frame(top.text("reference")) if "reference" in top else None,
        lidar=tuple(_frame(name) for name in top.texts("lidar")),
        segments=tuple(read_segment(table) for table in top.tables("segments")),
        base=kind,
        base_damping=damping,
        base_armature=armature,
        base_stiffness=stiffness,
        base_rest_position=_triple(base, "rest_position", kind, at_least=-math.inf),
        height=home.number("height") if "height" in home else None,
        joint_position=_numbers(home, "joints"),
        friction=_numbers(top, "friction", at_least=0.0),
        armature=_numbers(top, "armature", at_least=0.0),
        damping=_numbers(top, "damping", at_least=0.0),
        stiffness=_numbers(top, "stiffness", at_least=0.0),
        rest_position=_numbers(top, "rest_position"),
        actuators=tuple(read_actuator(table) for table in top.tables("actuators")),
        sensors=tuple(read_sensor(table) for table in top.tables("sensors")),
    )
    for table in (top, base, home):
        table.finish()
    _report_taken_names(top, "actuators", [actuator.name for actuator in result.actuators])
    _report_taken_names(top, "sensors", [sensor.name for sensor in result.sensors])
    return result


def _triple(base: Table, key: str, kind: BaseKind | None, *, at_least: float = 0.0) -> Vector3:
    if key in base and kind not in {None, "planar"}:
        base.error(key, f"belongs to a planar base, and this one is {kind}: remove it")
    values = base.vector(key, 3, ORIGIN)
    if min(values) < at_least:
        base.error(key, f"{list(values)} must not be negative")
    return as_vector(values)


def _numbers(top: Table, key: str, at_least: float = -math.inf) -> dict[str, float]:
    """Return the numbers of a table whose keys are names of the user's choice."""
    table = top.table(key)
    return {name: table.number(name, at_least=at_least) for name in table}


def _frame(name: str) -> Frame:
    return Frame(name=name, link=name)


def _report_taken_names(top: Table, key: str, names: list[str]) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            top.error(f"{key}[{i}].name", f"{name!r} is taken by {key}[{names.index(name)}]: rename one")
