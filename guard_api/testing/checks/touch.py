"""C7: touch and contact flags tell of every substep, of the robot alone, and only of what is not the robot."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guard_api import rotations
from guard_api.model.inertia import as_vector
from guard_api.model.robot import Collision, Joint, Link
from guard_api.physics.backend import Backend
from guard_api.shapes import Pose
from guard_api.testing.checks.check import Finding, check, count, error
from guard_api.testing.checks.frames import SKEW
from guard_api.testing.checks.stepping import Values
from guard_api.testing.robots import touch_sensor
from guard_api.testing.scenes import (
    RADIUS,
    TIMESTEP,
    WEIGHTLESS,
    ball,
    bodies_scene,
    body,
    cube,
    diagonal,
    effort_actuator,
    foot,
    gantry,
    idle,
    loose_link,
    one_joint,
    pusher,
    robot_scene,
    running,
    with_sensors,
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
    sole = touch_sensor("tip", place=(0.0, 0.0, -RADIUS), radius=0.02, name="sole")
    robot = with_sensors(foot(RADIUS + 0.0005, (effort_actuator(),)), sole)
    scene = robot_scene(robot, gravity=(0.0, 0.0, -GRAVITY), ground=True)
    with running(backend, scene, joint_velocity=speed) as world:
        world.step(idle(world) + force, SUBSTEPS)
        state = world.state()
        world.step(idle(world) + force, 1)
        later = world.state()
    duration = SUBSTEPS * TIMESTEP
    impulse = mass * (state.joint_velocity[0, 0] - speed) + (mass * GRAVITY - force) * duration
    mean = impulse / duration
    return [
        count("the foot is not off the floor at the end, as the check needs", int(state.joint_position[0, 0] < 0.01)),
        error("mean touch force, of all and of the sole", state.touch[0], mean, IMPULSE * abs(mean), "N"),
        error("touch one substep later", later.touch[0], 0.0, 0.0, "N"),
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
        sensors=(
            touch_sensor("tip"),
            touch_sensor("twin"),
            touch_sensor("tip", place=(-RADIUS, 0.0, 0.0), radius=0.02, name="wall_side"),
            touch_sensor("tip", place=(RADIUS, 0.0, 0.0), radius=0.02, name="twin_side"),
        ),
    )
    scene = bodies_scene(("wall", body("static"), 1), robot=robot, gravity=WEIGHTLESS, ground=False)
    with running(backend, scene, body_position=(-2 * RADIUS - 0.001, 0.0, 0.0)) as world:
        world.step(np.array([[-10.0, -10.0]]), 4 * SUBSTEPS)
        touch = world.state().touch[0]
    return [
        error("touch of the link pressed against a link", touch[1], 0.0, 0.0, "N"),
        count("touch of the link pressed against the wall missed", int(not touch[0] > 0)),
        error("touch of its side at the wall", touch[2], touch[0], 1e-6 * touch[0], "N"),
        error("touch of its side at the robot's own link", touch[3], 0.0, 0.0, "N"),
    ]


INSIDE, BEHIND, AHEAD, ASIDE, ALL = "inside", "behind the contact", "ahead of it", "beside it", "anywhere"


@check("C7", contacts=True)
def touch_is_within_the_radius(backend: Backend) -> list[Finding]:
    """Of five sensors on a link, only those feel a contact whose sphere its normal out of the link meets.

    A ball in turned axes is pressed against a wall with 10 N at one known point.
    """
    force = 10.0
    places = {
        INSIDE: (0.0, 0.005),
        BEHIND: (-RADIUS, 0.0),
        AHEAD: (0.05, 0.01),
        ASIDE: (0.0, 0.05),
        ALL: (-RADIUS, 0.0),
    }
    expected = {INSIDE: force, BEHIND: 0.0, AHEAD: force, ASIDE: 0.0, ALL: force}
    toward, sideways = (rotations.unrotate(SKEW, axis) for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    sensors = [
        touch_sensor("tip", place=as_vector((RADIUS + x) * toward + y * sideways), name=name,
                     radius=np.inf if name == ALL else 0.02)
        for name, (x, y) in places.items()
    ]  # fmt: skip
    w, x, y, z = SKEW.tolist()
    turned = Pose(position=(0.0, 0.0, 0.5), quaternion=(w, x, y, z))
    robot = one_joint(axis=as_vector(toward), collisions=(ball(),), actuators=(effort_actuator(),), origin=turned)
    scene = bodies_scene(("wall", body("static"), 1), robot=replace(robot, sensors=tuple(sensors)),
                         gravity=WEIGHTLESS, ground=False)  # fmt: skip
    with running(backend, scene, body_position=(2 * RADIUS + 1e-4, 0.0, 0.5)) as world:
        world.step(idle(world) + force, 10 * SUBSTEPS)
        world.step(idle(world) + force, SUBSTEPS)
        touch = world.state().touch[0]
    return [
        error(f"touch of a sensor {name}", touch[k], expected[name], 2e-3 * force, "N") for k, name in enumerate(places)
    ]


@check("C7", contacts=True)
def touch_is_shared_by_place(backend: Backend) -> list[Finding]:
    """A cube that leans to one side shows how much with a sensor on each: the law of the lever."""
    mass, lean = 2.0, 0.04
    left, right = (
        touch_sensor("hull", place=(side * RADIUS, 0.0, -RADIUS), radius=1.2 * RADIUS, name=name)
        for name, side in (("left", -1.0), ("right", 1.0))
    )
    robot = with_sensors(loose_link(mass=mass, com=(lean, 0.0, 0.0), collisions=(cube(),)), left, right)
    scene = robot_scene(robot, gravity=(0.0, 0.0, -GRAVITY), ground=True)
    with running(backend, scene, base_position=(0.0, 0.0, RADIUS)) as world:
        world.step(idle(world), 20 * SUBSTEPS)
        world.step(idle(world), 4 * SUBSTEPS)
        touch = world.state().touch[0]
    weight = mass * GRAVITY
    shares = 0.5 + np.array([-lean, lean]) / (2 * RADIUS)
    return [
        error("touch of the whole cube", touch[0], weight, 2e-3 * weight, "N"),
        error("touch of the left and the right side", touch[1:], shares * weight, 0.01 * weight, "N"),
    ]


@check("C7", contacts=True)
def touch_keeps_up_with_motion(backend: Backend) -> list[Finding]:
    """A sensor of 5 mm at the sole of a ball that slides at 5 m/s, 10 mm a timestep, feels all of its weight."""
    mass, speed, smooth = 2.0, 5.0, ball(friction=0.0)
    sole = {"place": (0.0, 0.0, -RADIUS), "radius": 0.005, "name": "sole"}
    loose = with_sensors(
        loose_link(mass=mass, com=(0.0, 0.0, -0.02), collisions=(smooth,)), touch_sensor("hull", **sole)
    )
    led = with_sensors(gantry(mass, smooth), touch_sensor("tip", **sole))
    thrown: Values = {"base_position": (0.0, 0.0, RADIUS), "base_linear_velocity": (speed, 0.0, 0.0)}
    pushed: Values = {"joint_velocity": (speed, 0.0)}
    findings = []
    for name, robot, start in (("a free ball", loose, thrown), ("a ball on two sliders", led, pushed)):
        scene = robot_scene(robot, gravity=(0.0, 0.0, -GRAVITY), ground=True)
        with running(backend, scene, 1, **start) as world:
            world.step(idle(world), 4 * SUBSTEPS)
            touch = world.state().touch[0]
        findings.append(error(f"touch of the sole of {name}", touch[1], touch[0], 1e-6 * mass * GRAVITY, "N"))
        findings.append(count(f"touch of {name} missed", int(not touch[0] > 0.9 * mass * GRAVITY)))
    return findings
