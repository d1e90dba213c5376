"""How a robot lies or stands on the floor by its own weight: no deeper than a contact gives, and carried whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import Collision, RobotModel
from guard_api.physics.backend import Backend
from guard_api.physics.state import State
from guard_api.scene.spec import SceneSpec
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from guard_api.testing.checks.check import Finding, error
from guard_api.testing.robots import touch_sensor
from guard_api.testing.scenes import running

Array = NDArray[np.float64]

G = 9.81

SETTLE, WATCH = 3.0, 0.5
"""Time to come to rest, and then to measure the mean force [s]."""

DEPTH = 1e-3
"""How deep a robot may rest in the floor [m]: the softest preset sinks with the square of the timestep, to 0.9 mm at
Ant's 0.02 s."""

LOAD = 0.02
"""Share of the weight by which the mean force on the floor may differ from it."""

STILL = 0.02
"""Most speed of a link of a robot at rest [m/s]: solvers let a standing robot creep."""


def lies_on_floor(robot: RobotModel) -> bool:
    """Return whether the floor alone carries `robot`: it floats, or every link that touches can rise on a slide."""
    touching = [link.name for link in robot.links if link.collisions]
    if not robot.collide_ground or not touching:
        return False
    if robot.floating:
        return True
    upright, q = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, len(robot.joints)))
    poses = Kinematics(robot).poses(np.zeros((1, 3)), upright, q)
    rises = {robot.links[0].name: False}
    for joint in robot.joints:  # parents before children
        axis = rotations.rotate(poses.quaternion[0, robot.link_index(joint.child)], np.array(joint.axis))
        rises[joint.child] = rises[joint.parent] or (joint.kind == "prismatic" and abs(axis[2]) > 1.0 - 1e-9)
    return all(rises[name] for name in touching)


def rests_on_floor(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Let `robot` settle on the floor from home, its drives without force, and weigh it.

    The normal forces on all of its links, from everything that is not the robot, add up to its weight: on a level floor
    nothing else carries.
    """
    sensors = tuple(touch_sensor(link.name) for link in robot.links if link.collisions)
    whole = replace(robot, sensors=sensors)
    control = np.array([[0.0 if a.law != "thrust" or not a.gear else -a.offset / a.gear for a in robot.actuators]])
    weight = G * sum(link.mass for link in robot.links)
    h = robot.timestep
    with running(backend, SceneSpec(robot=whole, timestep=h)) as world:
        world.step(control, round(SETTLE / h))
        before = world.state()
        world.step(control, round(WATCH / h))
        state = world.state()
    speed = np.abs(state.link_position - before.link_position).max() / WATCH
    return [
        error("lowest point at rest", lowest_point(robot, state), 0.0, DEPTH, "m"),
        error("force of the floor / weight", state.touch.sum() / weight, 1.0, LOAD, "relative"),
        Finding(what="speed at rest", value=float(speed), tolerance=STILL, unit="m/s"),
    ]


def lowest_point(robot: RobotModel, state: State) -> Array:
    """Return the height (N,) [m] of the lowest point of the shapes of `robot` in `state`."""
    heights = []
    for i, link in enumerate(robot.links):
        for collision in link.collisions:
            turn = rotations.multiply(state.link_quaternion[:, i], np.array(collision.pose.quaternion))
            arm = rotations.rotate(state.link_quaternion[:, i], np.array(collision.pose.position))
            down = rotations.unrotate(turn, np.array([0.0, 0.0, 1.0]))
            heights.append(state.link_position[:, i, 2] + arm[:, 2] - _reach(collision, down))
    return np.min(heights, axis=0)


def _reach(collision: Collision, down: Array) -> Array:
    """Return how far a shape reaches from its middle along the unit `down` (N, 3) or against it, in its axes: (N,)."""
    match collision.shape:
        case Sphere(radius=radius):
            return np.full(len(down), radius)
        case Box(half_extents=half):
            return (np.abs(down) * half).sum(axis=1)
        case Capsule(radius=radius, half_length=half):
            return radius + half * np.abs(down[:, 2])
        case Cylinder(radius=radius, half_length=half):
            return radius * np.hypot(down[:, 0], down[:, 1]) + half * np.abs(down[:, 2])
        case Mesh(vertices=vertices):
            return -(down @ np.array(vertices).T).min(axis=1)
