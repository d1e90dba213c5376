"""Reads the actuators, sensors and segments of a side file, one table each."""

from __future__ import annotations

import math
from typing import cast, get_args

from guard_api import rotations
from guard_api.model.inertia import as_vector
from guard_api.model.robot import Actuator, ActuatorLaw, Frame, Segment, Sensor, SensorKind
from guard_api.model.toml_table import Table
from guard_api.shapes import ORIGIN, Pose, Vector3

_PREFIXES: dict[SensorKind, str] = {
    "touch": "touch",
    "joint_position": "jointpos",
    "joint_velocity": "jointvel",
    "relative_rotation": "ballquat",
    "relative_angular_velocity": "ballangvel",
}
"""What the default name of a sensor begins with, before its link or joint; the others are named like their kind."""


def read_actuator(table: Table) -> Actuator:
    """Return the actuator in `table`, its link and joint as named there."""
    name = table.text("name")
    law = cast(ActuatorLaw, table.text("law", choices=get_args(ActuatorLaw)))
    lower, upper = table.vector("ctrl_range", 2, (-1.0, 1.0))
    if lower >= upper:
        table.error("ctrl_range", f"[{lower:g}, {upper:g}] must be increasing")
    gear = table.number("gear", 1.0)
    if gear == 0.0:
        table.error("gear", "0 means that the control does nothing: give another or remove the actuator")
    thrust = law == "thrust"
    kp, kd = _gains(table, law)
    actuator = Actuator(
        name=name,
        law=law,
        joint=None if thrust else table.text("joint"),
        link=table.text("link") if thrust else None,
        point=as_vector(table.vector("point", 3, ORIGIN)) if thrust else ORIGIN,
        direction=_direction(table) if thrust else (0.0, 0.0, 1.0),
        gear=gear,
        offset=table.number("offset", 0.0) if law != "effort" else 0.0,
        ctrl_range=(lower, upper),
        kp=kp,
        kd=kd,
        effort_limit=table.number("effort_limit", above=0.0) if "effort_limit" in table else math.inf,
        ceiling=table.number("ceiling") if thrust and "ceiling" in table else math.inf,
    )
    table.finish()
    return actuator


def read_sensor(table: Table) -> Sensor:
    """Return the sensor in `table`, its link or joint as named there."""
    kind = cast(SensorKind, table.text("kind", choices=get_args(SensorKind)))
    on_joint = kind in {"joint_position", "joint_velocity"}
    place = table.text("joint" if on_joint else "link")
    sensor = Sensor(
        name=table.text("name", f"{_PREFIXES[kind]}_{place}" if kind in _PREFIXES else kind),
        kind=kind,
        link=None if on_joint else place,
        joint=place if on_joint else None,
        pose=_site(table, kind),
        radius=table.number("radius", above=0.0) if kind == "touch" and "radius" in table else math.inf,
    )
    table.finish()
    return sensor


def read_segment(table: Table) -> Segment:
    """Return the segment in `table` between the links' frames, as named there."""
    start, end = (Frame(name=name, link=name) for name in (table.text("start"), table.text("end")))
    segment = Segment(start=start, end=end, radius=table.number("radius", 0.0, at_least=0.0))
    table.finish()
    return segment


def _gains(table: Table, law: ActuatorLaw) -> tuple[float, float]:
    if law == "position":
        return table.number("kp", above=0.0), table.number("kd", 0.0, at_least=0.0)
    return 0.0, table.number("kd", above=0.0) if law == "velocity" else 0.0


def _direction(table: Table) -> Vector3:
    x, y, z = table.vector("direction", 3)
    norm = math.hypot(x, y, z)
    if norm == 0.0:
        table.error("direction", "[0, 0, 0] has no direction: give a vector")
        return 0.0, 0.0, 1.0
    return x / norm, y / norm, z / norm


def _site(table: Table, kind: SensorKind) -> Pose:
    """Return where the sensor sits; a touch sensor has a place without axes, other non-inertial ones have neither."""
    if kind in _PREFIXES and kind != "touch":
        return Pose()
    position = as_vector(table.vector("position", 3, ORIGIN))
    if kind == "touch":
        return Pose(position=position)
    roll, pitch, yaw = table.vector("rpy", 3, ORIGIN)
    w, x, y, z = (float(value) for value in rotations.from_rpy(roll, pitch, yaw))
    return Pose(position=position, quaternion=(w, x, y, z))
