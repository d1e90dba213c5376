"""Reads `robot.toml`: what a robot file cannot say.

Every key, with its default or an example:

    licence = ""               # SPDX expression, such as "CC0-1.0"
    keepout = 0.4              # radius kept free around the robot in layouts [m]
    timestep = 0.002           # physics step [s], the same in every engine
    substeps = 10              # physics steps per environment step
    collide_ground = true      # false by default for a planar base, whose height is fixed
    density = 1000.0           # [kg/m^3] for links without <inertial>; no default: nothing is invented
    touch = ["foot"]           # links whose contact force is measured, in the order of `State.touch`
    [base]
    kind = "fixed"             # "fixed", "planar" (x, y and heading) or "floating"
    damping = [0, 0, 0]        # planar only: of base_x, base_y [N s/m] and base_yaw [N m s/rad]
    armature = [0, 0, 0]       # planar only: [kg], [kg], [kg m^2]

    [home]
    height = 0.0               # of the root link's frame where an episode starts [m]
    joints = { hip = 0.3 }     # positions there [rad or m]; 0 for those left out

    [friction]                 # friction coefficients, by the name of a link or of a <collision>
    default = 1.0
    foot = 2.0

    [armature]                 # rotor inertia, by joint [kg m^2 or kg]; the planar base has its own
    default = 0.0
    hip = 0.01

    [[actuators]]              # in the order of the action
    name = "hip"
    law = "effort"             # "effort", "position", "velocity" or "thrust": `guard_api.physics.actuation`
    joint = "hip"              # for thrust instead: link, direction = [x, y, z] and point = [0, 0, 0] in its axes
    gear = 1.0
    ctrl_range = [-1.0, 1.0]
    effort_limit = 5.0         # [N m or N]; unlimited when left out
    kp = 1.0                   # position only
    kd = 0.1                   # position (default 0) and velocity
    offset = 0.0               # position and velocity: target at control 0

    [[sensors]]                # in the order of the model
    kind = "gyro"              # "accelerometer", "velocimeter", "gyro" or "magnetometer"
    link = "torso"
    name = "gyro"              # default: the kind
    position = [0, 0, 0]       # [m], in the link's axes
    rpy = [0, 0, 0]            # [rad]

All names are those of the robot file; what sits on a link that is merged into another moves along with it.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast, get_args

from guard_api import rotations
from guard_api.model.inertia import as_vector
from guard_api.model.problems import Problems
from guard_api.model.robot import Actuator, ActuatorLaw, BaseKind, Sensor, SensorKind
from guard_api.model.toml_table import Table
from guard_api.shapes import ORIGIN, Pose, Vector3

DEFAULT = "default"
"""The key of `[friction]` and `[armature]` for everything that is not named there."""

LEAST_DENSITY = 1e-9
"""Density [kg/m^3] below which masses of small shapes would vanish in rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SideFile:
    """The contents of a `robot.toml`; None where a default depends on the robot. Names are not checked yet."""

    place: str = "robot.toml"
    licence: str = ""
    keepout: float = 0.4
    timestep: float = 0.002
    substeps: int = 10
    collide_ground: bool | None = None
    density: float | None = None
    touch: tuple[str, ...] = ()
    base: BaseKind | None = None
    base_damping: Vector3 = ORIGIN
    base_armature: Vector3 = ORIGIN
    height: float | None = None
    joint_position: dict[str, float] = field(default_factory=dict)
    friction: dict[str, float] = field(default_factory=dict)
    armature: dict[str, float] = field(default_factory=dict)
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
    damping, armature = (_triple(base, key, kind) for key in ("damping", "armature"))
    result = SideFile(
        place=str(path),
        licence=top.text("licence", ""),
        keepout=top.number("keepout", 0.4, above=0.0),
        timestep=top.number("timestep", 0.002, above=0.0),
        substeps=top.integer("substeps", 10, at_least=1),
        collide_ground=top.boolean("collide_ground", True) if "collide_ground" in top else None,
        density=top.number("density", above=LEAST_DENSITY) if "density" in top else None,
        touch=top.texts("touch"),
        base=kind,
        base_damping=damping,
        base_armature=armature,
        height=home.number("height") if "height" in home else None,
        joint_position=_numbers(home.table("joints")),
        friction=_not_negative(top, "friction"),
        armature=_not_negative(top, "armature"),
        actuators=tuple(_actuator(table) for table in top.tables("actuators")),
        sensors=tuple(_sensor(table) for table in top.tables("sensors")),
    )
    for table in (top, base, home):
        table.finish()
    _report_taken_names(top, "actuators", [actuator.name for actuator in result.actuators])
    _report_taken_names(top, "sensors", [sensor.name for sensor in result.sensors])
    return result


def _triple(base: Table, key: str, kind: BaseKind | None) -> Vector3:
    if key in base and kind not in {None, "planar"}:
        base.error(key, f"belongs to a planar base, and this one is {kind}: remove it")
    values = base.vector(key, 3, ORIGIN)
    if min(values) < 0.0:
        base.error(key, f"{list(values)} must not be negative")
    return as_vector(values)


def _numbers(table: Table) -> dict[str, float]:
    """Return a table whose keys are names of the user's choice."""
    return {name: table.number(name) for name in table}


def _not_negative(top: Table, key: str) -> dict[str, float]:
    values = _numbers(top.table(key))
    for name, value in values.items():
        if value < 0.0:
            top.error(f"{key}.{name}", f"{value!r} must not be negative")
    return values


def _actuator(table: Table) -> Actuator:
    name = table.text("name")
    law = cast(ActuatorLaw, table.text("law", choices=get_args(ActuatorLaw)))
    lower, upper = table.vector("ctrl_range", 2, (-1.0, 1.0))
    if lower >= upper:
        table.error("ctrl_range", f"[{lower:g}, {upper:g}] must be increasing")
    gear = table.number("gear", 1.0)
    if gear == 0.0:
        table.error("gear", "0 means that the control does nothing: give another or remove the actuator")
    thrust, servo = law == "thrust", law in {"position", "velocity"}
    actuator = Actuator(
        name=name,
        law=law,
        joint=None if thrust else table.text("joint"),
        link=table.text("link") if thrust else None,
        point=as_vector(table.vector("point", 3, ORIGIN)) if thrust else ORIGIN,
        direction=_direction(table) if thrust else (0.0, 0.0, 1.0),
        gear=gear,
        offset=table.number("offset", 0.0) if servo else 0.0,
        ctrl_range=(lower, upper),
        kp=table.number("kp", above=0.0) if law == "position" else 0.0,
        kd=_velocity_gain(table, law) if servo else 0.0,
        effort_limit=table.number("effort_limit", above=0.0) if "effort_limit" in table else math.inf,
    )
    table.finish()
    return actuator


def _velocity_gain(table: Table, law: ActuatorLaw) -> float:
    if law == "velocity":
        return table.number("kd", above=0.0)
    kd = table.number("kd", 0.0)
    if kd < 0.0:
        table.error("kd", f"{kd!r} must not be negative")
    return kd


def _direction(table: Table) -> Vector3:
    x, y, z = table.vector("direction", 3)
    norm = math.hypot(x, y, z)
    if norm == 0.0:
        table.error("direction", "[0, 0, 0] has no direction: give a vector")
        return 0.0, 0.0, 1.0
    return x / norm, y / norm, z / norm


def _sensor(table: Table) -> Sensor:
    kind = cast(SensorKind, table.text("kind", choices=get_args(SensorKind)))
    position, rpy = table.vector("position", 3, ORIGIN), table.vector("rpy", 3, ORIGIN)
    w, x, y, z = (float(value) for value in rotations.from_rpy(rpy[0], rpy[1], rpy[2]))
    sensor = Sensor(
        name=table.text("name", kind),
        kind=kind,
        link=table.text("link"),
        pose=Pose(position=as_vector(position), quaternion=(w, x, y, z)),
    )
    table.finish()
    return sensor


def _report_taken_names(top: Table, key: str, names: list[str]) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            top.error(f"{key}[{i}].name", f"{name!r} is taken by {key}[{names.index(name)}]: rename one")
