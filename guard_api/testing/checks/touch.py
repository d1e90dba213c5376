"""C7: touch and contact flags tell of every substep, of the robot alone, and only of what is not the robot."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guard_api.model.robot import Collision, Joint, Link
from guard_api.physics.backend import Backend
from guard_api.shapes import Pose
from guard_api.testing.checks.check import Finding, check, count, error
from guard_api.testing.scenes import (
    RADIUS,
    TIMESTEP,
    WEIGHTLESS,
    ball,
    bodies_scene,
    body,
    diagonal,
    effort_actuator,
    foot,
    idle,
    one_joint,
    pusher,
    robot_scene,
    running,
)

SUBSTEPS = 25
GRAVITY = 9.81

IMPULSE = 0.01
"""Relative tolerance of a reported contact impulse: solvers stop at a residual of this order, and the impulse theorem
itself is exact however soft the contact."""


@check("C7", contacts=True)
def touch_covers_all_substeps(backend: Backend) -> list[Finding]:
    """A foot that hits the floor in the first substeps and lifts off leaves its whole impulse in `touch`.

    Impulse theorem over the step of duration T: touch T = m (v1 - v0) + (m g - F) T.
    """
    mass, speed, force = 2.0, -1.0, 60.0
    scene = robot_scene(foot(RADIUS + 0.0005, (effort_actuator(),)), gravity=(0.0, 0.0, -GRAVITY), ground=True)
    with running(backend, scene, joint_velocity=speed) as world:
        world.step(idle(world) + force, SUBSTEPS)
        state = world.state()
        world.step(idle(world) + force, 1)
        later = world.state()
    duration = SUBSTEPS * TIMESTEP
    impulse = mass * (state.joint_velocity[0, 0] - speed) + (mass * GRAVITY - force) * duration
    return [
        count("the foot is not off the floor at the end, as the check needs", int(state.joint_position[0, 0] < 0.01)),
        error("mean touch force", state.touch[0, 0], impulse / duration, IMPULSE * abs(impulse) / duration, "N"),
        error("touch one substep later", later.touch[0, 0], 0.0, 0.0, "N"),
    ]


@check("C7", contacts=True)
def contact_flag_covers_all_substeps(backend: Backend) -> list[Finding]:
    """A robot that hits a body in an early substep and is pulled back has touched it in that step, not in the next."""
    findings = []
    for physics in ("static", "dynamic", "driven"):
        robot = pusher((effort_actuator(),))
        scene = bodies_scene(("box", body(physics), 1), robot=robot, gravity=WEIGHTLESS, ground=False)
        start = {"joint_velocity": 1.0, "body_position": (2 * RADIUS + 0.0005, 0.0, 0.5)}
        with running(backend, scene, **start) as world:
            world.step(idle(world) - 60.0, SUBSTEPS)
            state = world.state()
            world.step(idle(world) - 60.0, 1)
            later = world.state()
        findings += [
            count(f"contacts with a {physics} body missed", int(not state.body_contact[0, 0])),
            count(f"touch on a {physics} body missed", int(not state.touch[0, 0] > 0)),
            count(f"contact flags of a {physics} body kept after it", int(later.body_contact[0, 0])),
        ]
    return findings


@check("C7", contacts=True)
def contact_flags_are_the_robots(backend: Backend) -> list[Finding]:
    """Bodies that touch the floor or each other, or come near the robot, are not touched by it."""
    robot = pusher()
    scene = bodies_scene(("box", body(), 3), robot=robot)
    place = [(2.0, 0.0, RADIUS), (2.0, 0.0, 3 * RADIUS), (2 * RADIUS + 0.02, 0.0, 0.5)]
    with running(backend, scene, body_position=place) as world:
        world.step(idle(world), 1)
        state = world.state()
        world.step(idle(world), 20)
        later = world.state()
    return [
        count("false contacts", int(state.body_contact.sum()) + int(later.body_contact.sum())),
        error("touch of the robot", state.touch, 0.0, 0.0, "N"),
        error(
            "heights of the stack that the check needs", later.body_position[0, :2, 2], [RADIUS, 3 * RADIUS], 1e-3, "m"
        ),
    ]


@check("C7", contacts=True)
def touch_is_from_others(backend: Backend) -> list[Finding]:
    """A link pressed against the robot's own link feels no touch; one pressed against a wall does."""
    one = one_joint(collisions=(ball(),), actuators=(effort_actuator(),))
    twin = Link(name="twin", mass=2.0, inertia=diagonal(0.05, 0.05, 0.05), collisions=(Collision(shape=ball().shape),))
    side = Joint(
        name="side", kind="prismatic", parent="root", child="twin", axis=(1.0, 0.0, 0.0),
        origin=Pose(position=(2 * RADIUS + 0.001, 0.0, 0.0)),
    )  # fmt: skip
    robot = replace(
        one,
        links=(*one.links, twin),
        joints=(*one.joints, side),
        actuators=(*one.actuators, effort_actuator("side")),
        touch_links=("tip", "twin"),
    )
    scene = bodies_scene(("wall", body("static"), 1), robot=robot, gravity=WEIGHTLESS, ground=False)
    with running(backend, scene, body_position=(-2 * RADIUS - 0.001, 0.0, 0.0)) as world:
        world.step(np.array([[-10.0, -10.0]]), 4 * SUBSTEPS)
        touch = world.state().touch[0]
    return [
        error("touch of the link pressed against a link", touch[1], 0.0, 0.0, "N"),
        count("touch of the link pressed against the wall missed", int(not touch[0] > 0)),
    ]
