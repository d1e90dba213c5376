"""C12 with contacts: what robots and driven bodies push, and what static bodies stop."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

import numpy as np

from guard_api import rotations
from guard_api.physics.backend import Backend
from guard_api.testing.checks.check import Finding, check, count, error, rounding
from guard_api.testing.checks.contact import PENETRATION
from guard_api.testing.checks.stepping import Values
from guard_api.testing.scenes import (
    RADIUS,
    TIMESTEP,
    bodies_scene,
    body,
    differing,
    effort_actuator,
    idle,
    planar_ball,
    pusher,
    running,
)


@check("C12", contacts=True)
def static_bodies_block(backend: Backend) -> list[Finding]:
    """A static body stops a driven robot and does not move by one bit."""
    scene = bodies_scene(("wall", body("static"), 1), robot=pusher((effort_actuator(),)))
    with running(backend, scene, body_position=(0.5, 0.0, 0.5)) as world:
        before = world.state()
        world.step(idle(world) + 20.0, 500)
        after = world.state()
    moved = differing(before, after, ("body_position", "body_quaternion"))
    return [
        error("where the robot stops", after.joint_position[0, 0], 0.5 - 2 * RADIUS, 5 * PENETRATION, "m"),
        error("speed of the stopped robot", after.joint_velocity[0, 0], 0.0, 1e-3, "m/s"),
        error("touch", after.touch[0, 0], after.joint_effort[0, 0], 0.05 * 20.0, "N"),
        count("arrays of the static body changed", moved),
    ]


@check("C12")
def driven_bodies_follow(backend: Backend) -> list[Finding]:
    """A driven body reaches its pose by the end of the step and reports the velocity of its way."""
    scene = bodies_scene(("car", body("driven"), 2))
    turn = rotations.from_axis_angle([0.0, 0.0, 1.0], np.array(0.02))
    goal = np.array([[[0.01, 0.02, 0.5], [1.0, 0.0, 0.5]]])
    facing = np.broadcast_to(np.stack([[1.0, 0.0, 0.0, 0.0], turn]), (1, 2, 4))
    with running(backend, scene, body_position=[(0, 0, 0.5), (1, 0, 0.5)]) as world:
        world.drive("car", goal, facing)
        world.step(idle(world), 10)
        state = world.state()
        world.step(idle(world), 10)
        later = world.state()
    speed = 1.0 / (10 * TIMESTEP)
    # Ten substeps add up ten rounded moves; the velocity divides a rounded move by the time.
    noise = rounding(backend, 1.0, 10, operations=16)
    linear = [[0.01 * speed, 0.02 * speed, 0.0], [0.0, 0.0, 0.0]]
    angular = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.02 * speed]]
    return [
        error("positions", state.body_position, goal, noise, "m"),
        error("quaternions", state.body_quaternion, facing, noise),
        error("velocities", state.body_linear_velocity[0], linear, noise * speed, "m/s"),
        error("angular velocities", state.body_angular_velocity[0], angular, noise * speed, "rad/s"),
        error("positions when driven no more", later.body_position, goal, noise, "m"),
    ]


@check("C12", contacts=True)
def driven_bodies_push(backend: Backend) -> list[Finding]:
    """A driven body pushes bodies and robots ahead of it at its own speed, in touch with them.

    Once in contact the mean speed over 0.3 s is the driver's; the distance is that of touching shapes.
    """
    speed, step, calls = 0.5, 10, 40
    scene = bodies_scene(("car", body("driven"), 2), ("box", body(), 1), robot=pusher(damping=5.0))
    place = np.array([[[-0.25, 2.0, RADIUS], [-0.25, 0.0, 0.5]]])
    trail = []
    with running(backend, scene, body_position=[*place[0], (0.0, 2.0, RADIUS)]) as world:
        for i in range(1, calls + 1):
            goal = place + np.multiply(speed * step * TIMESTEP * i, [1.0, 0.0, 0.0])
            world.drive("car", goal, np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, 2, 4)))
            world.step(idle(world), step)
            there = world.state()
            trail.append([there.body_position[0, 2, 0], there.joint_position[0, 0]])
        state = world.state()
    ahead = np.array(trail)
    mean = (ahead[-1] - ahead[-16]) / (15 * step * TIMESTEP)
    gap = ahead[-1] - state.body_position[0, :2, 0]
    return [
        error("speed of a pushed body", mean[0], speed, 0.02 * speed, "m/s"),
        error("speed of a pushed robot", mean[1], speed, 0.02 * speed, "m/s"),
        error("distance of the centres", gap, 2 * RADIUS, 1e-3, "m"),
        count("pushes that the robot did not notice", int(not state.body_contact[0, 1])),
        count("touches of the other car or box", int(state.body_contact[0, [0, 2]].sum())),
    ]


@check("C12", contacts=True)
def robots_push_bodies(backend: Backend) -> list[Finding]:
    """A robot that pushes a box over a smooth floor accelerates both by F / (M + m).

    Everything is smooth: friction between robot and box would tilt the box, which no formula covers.
    """
    force, mass = 15.0, 1.0
    robot = pusher((effort_actuator(),), friction=0.0)
    scene = bodies_scene(("box", body(half=0.5, friction=0.0, mass=mass), 1), robot=robot)
    with running(backend, scene, body_position=(0.5 + RADIUS, 0.0, 0.5)) as world:
        world.step(idle(world) + force, 50)
        early = world.state()
        world.step(idle(world) + force, 100)
        late = world.state()
    gain = (late.joint_velocity - early.joint_velocity)[0, 0] / (100 * TIMESTEP)
    expected = force / (2.0 + mass)
    return [
        error("acceleration of the robot", gain, expected, 0.02 * expected, "m/s^2"),
        error("lag of the box", late.body_position[0, 0, 0] - late.joint_position[0, 0], 0.5 + RADIUS, 1e-3, "m"),
        count("contact missed", int(not late.body_contact[0, 0])),
    ]


@check("C12", contacts=True)
def planar_robots_ignore_the_floor(backend: Backend) -> list[Finding]:
    """A robot with collide_ground False glides through the floor, unbraked and untouched, on which a box rests."""
    scene = bodies_scene(("box", body(), 1), robot=planar_ball(0.5 * RADIUS))
    start: Values = {"joint_velocity": (0.7, -0.4, 1.0), "body_position": (0.0, 5.0, RADIUS)}
    with running(backend, scene, 1, **start) as world:
        world.step(idle(world), 100)
        state = world.state()
    noise = rounding(backend, 1.0, 100, operations=16)
    return [
        error("velocity", state.joint_velocity[0], [0.7, -0.4, 1.0], noise, "m/s, rad/s"),
        error("touch", state.touch, 0.0, 0.0, "N"),
        error("height of a box on the floor", state.body_position[0, 0, 2], RADIUS, PENETRATION, "m"),
    ]
