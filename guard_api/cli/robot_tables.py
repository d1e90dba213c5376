"""A robot as rows of plain data: what `guard robot show` prints."""

from __future__ import annotations

from typing import Any

import numpy as np

from guard_api.model.robot import Actuator, Joint, Link, RobotModel, Sensor
from guard_api.physics.transition import SnapshotReader, Transition
from guard_api.sensors.inertial import InertialSensors
from guard_api.sensors.proprioception import Proprioception
from guard_api.viewer.home import home_state


def robot_tables(robot: RobotModel) -> dict[str, Any]:
    """Return the robot's own properties, and one row for each link, joint, actuator, sensor and reading."""
    return {
        "robot": _properties(robot),
        "links": [_link(link, robot) for link in robot.links],
        "joints": [_joint(joint) for joint in robot.joints],
        "actuators": [_actuator(actuator) for actuator in robot.actuators],
        "sensors": [_sensor(sensor) for sensor in robot.sensors],
        "observation": _observation(robot),
        "notes": list(robot.notes),
    }


def _properties(robot: RobotModel) -> dict[str, Any]:
    return {
        "base": robot.base,
        "root": robot.root,
        "reference": robot.reference.name if robot.reference else robot.root,
        "lidar on": [frame.name for frame in robot.lidar] or ["the reference"],
        "mass [kg]": sum(link.mass for link in robot.links),
        "home height [m]": robot.home.height,
        "home joints": dict(robot.home.joint_position),
        "keepout [m]": robot.keepout,
        "timestep [s]": robot.timestep,
        "substeps": robot.substeps,
        "collides with the ground": robot.collide_ground,
        "licence": robot.licence,
    }


def _link(link: Link, robot: RobotModel) -> dict[str, Any]:
    ixx, iyy, izz = (link.inertia[i][i] for i in range(3))
    return {
        "link": link.name + (" (root)" if link.name == robot.root else ""),
        "mass [kg]": link.mass,
        "com [m]": None if link.virtual else list(link.com),
        "inertia xx yy zz [kg m^2]": None if link.virtual else list((ixx, iyy, izz)),
        "collisions": _shapes([item.shape for item in link.collisions]),
        "visuals": _shapes([item.shape for item in link.visuals]),
    }


def _joint(joint: Joint) -> dict[str, Any]:
    return {
        "joint": joint.name,
        "kind": joint.kind,
        "parent": joint.parent,
        "child": joint.child,
        "axis": list(joint.axis),
        "limits": None if joint.limits is None else list(joint.limits),
        "damping": joint.damping,
        "friction": joint.friction_loss,
        "armature": joint.armature,
        "spring": joint.stiffness,
        "rests at": joint.rest_position,
    }


def _actuator(actuator: Actuator) -> dict[str, Any]:
    thrust = actuator.law == "thrust"
    return {
        "actuator": actuator.name,
        "law": actuator.law,
        "on": actuator.joint or actuator.link,
        "at [m]": list(actuator.point) if thrust else None,
        "along": list(actuator.direction) if thrust else None,
        "gear": actuator.gear,
        "offset": actuator.offset,
        "control": list(actuator.ctrl_range),
        "kp": actuator.kp,
        "kd": actuator.kd,
        "limit": actuator.effort_limit,
    }


def _sensor(sensor: Sensor) -> dict[str, Any]:
    return {
        "sensor": sensor.name,
        "kind": sensor.kind,
        "on": sensor.joint or sensor.link,
        "at [m]": None if sensor.joint else list(sensor.pose.position),
        "radius [m]": sensor.radius,
    }


def _observation(robot: RobotModel) -> list[dict[str, Any]]:
    """Return the readings of the robot's own sensors, in their order in every observation, as they are at home."""
    nowhere = {"bodies": {}, "origins": {}, "slices": {}, "steps_since_success": np.zeros(1, np.int64)}
    now = SnapshotReader(robot).read(home_state(robot), **nowhere)
    standstill = Transition(
        previous=now, now=now, action=np.zeros((1, len(robot.actuators))), duration=robot.substeps * robot.timestep
    )
    readings = InertialSensors(robot).read(standstill) | Proprioception(robot).read(standstill)
    return [
        {"reading": name, "size": readings[name].shape[1], "at home": readings[name][0].tolist()}
        for name in sorted(readings)
    ]


def _shapes(shapes: list[Any]) -> str:
    """Return what there is how often, such as `2 box, sphere`."""
    names = [type(shape).__name__.lower() for shape in shapes]
    return ", ".join(f"{names.count(n)} {n}" if names.count(n) > 1 else n for n in dict.fromkeys(names))
