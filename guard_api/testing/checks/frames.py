"""C1 and C2: units, axes, quaternions, and the order and shape of every array."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from guard_api.physics.backend import Backend
from guard_api.physics.state import State, state_dtype, state_shapes
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, check, count, error, rounding
from guard_api.testing.robots import touch_sensor
from guard_api.testing.scenes import (
    TIMESTEP,
    WEIGHTLESS,
    bodies_scene,
    body,
    idle,
    loose_link,
    one_joint,
    pusher,
    rest_start,
    robot_scene,
    running,
    tree,
)

SKEW = np.array([0.1, -0.5, 0.7, 0.5]) / np.linalg.norm([0.1, -0.5, 0.7, 0.5])
"""A rotation whose quaternion has four different components: no reordering or conjugation leaves it alone."""


@check("C1")
def gravity_axes(backend: Backend) -> list[Finding]:
    """Gravity is the scene's vector in world axes and m/s^2, whatever way the robot is turned."""
    gravity = (1.0, -2.0, 3.0)
    scene = robot_scene(loose_link(), gravity=gravity)
    with running(backend, scene, base_quaternion=SKEW) as world:
        world.step(idle(world), 1)
        velocity = world.state().link_linear_velocity[0, 0]
    return [error("velocity after one step", velocity, np.multiply(gravity, TIMESTEP), rounding(backend, 0.01), "m/s")]


@check("C1")
def quaternion_convention(backend: Backend) -> list[Finding]:
    """Quaternions are (w, x, y, z), link to world, unit within rounding also after motion."""
    scene = robot_scene(loose_link(com=(0.05, -0.02, 0.03)))
    spin = {"base_quaternion": SKEW, "base_angular_velocity": (3.0, -2.0, 4.0)}
    with running(backend, scene, **spin) as world:
        started = world.state().link_quaternion[0, 0]
        world.step(idle(world), 50)
        moved = world.state().link_quaternion[0, 0]
    sign = np.sign(started @ SKEW)
    return [
        error("pose after reset", sign * started, SKEW, rounding(backend)),
        error("norm after reset", np.linalg.norm(started), 1.0, rounding(backend, operations=8)),
        error("norm after motion", np.linalg.norm(moved), 1.0, rounding(backend, operations=8)),
    ]


@check("C1")
def radians_and_sense(backend: Backend) -> list[Finding]:
    """A hinge at +pi/2 about z turns its link from x to y; its velocity is in rad/s of the same sense."""
    robot = one_joint("continuous", axis=(0.0, 0.0, 1.0))
    with running(backend, robot_scene(robot), joint_position=np.pi / 2, joint_velocity=0.25) as world:
        state = world.state()
    half = np.sqrt(0.5)
    quaternion = state.link_quaternion[0, 1] * np.sign(state.link_quaternion[0, 1, 0])
    return [
        error("quaternion of the link", quaternion, [half, 0.0, 0.0, half], rounding(backend)),
        error("joint position", state.joint_position[0, 0], np.pi / 2, rounding(backend), "rad"),
        error("angular velocity", state.link_angular_velocity[0, 1], [0, 0, 0.25], rounding(backend), "rad/s"),
    ]


@check("C2")
def joint_order(backend: Backend) -> list[Finding]:
    """Joint positions and velocities keep the model's order."""
    findings = []
    for base in ("floating", "fixed"):
        robot = tree(base)
        numbers = 0.1 + 0.05 * np.arange(len(robot.joints))
        with running(backend, robot_scene(robot), joint_position=numbers, joint_velocity=-numbers) as world:
            state = world.state()
        findings += [
            error(f"positions, {base} base", state.joint_position[0], numbers, rounding(backend)),
            error(f"velocities, {base} base", state.joint_velocity[0], -numbers, rounding(backend)),
        ]
    return findings


@check("C2")
def actuator_order(backend: Backend) -> list[Finding]:
    """Control column i drives actuator i of the model, and its effort is reported on that actuator's joint."""
    robot = tree("fixed")
    controls = 0.1 * (1.0 + np.arange(len(robot.actuators)))
    expected = np.zeros(len(robot.joints))
    for actuator, value in zip(robot.actuators, controls, strict=True):
        expected[robot.joint_index(str(actuator.joint))] = value
    with running(backend, robot_scene(robot)) as world:
        world.step(controls[None], 1)
        effort = world.state().joint_effort[0]
    return [error("joint effort", effort, expected, rounding(backend), "N or N m")]


@check("C2")
def shapes_and_types(backend: Backend) -> list[Finding]:
    """Every array of the state has the contract's shape and dtype, with and without a robot."""
    sensors = (touch_sensor("beta"), touch_sensor("zeta", radius=0.1), touch_sensor("beta", name="again"))
    scene = robot_scene(replace(tree("floating"), sensors=sensors))
    with running(backend, scene, 2) as world:
        return [count("arrays that differ from the contract", _misshapen(world.state(), scene, 2))]


@check("C2")
def body_order(backend: Backend) -> list[Finding]:
    """Bodies are numbered through the groups in order, whatever their kind; each stands where its row put it."""
    scene = bodies_scene(
        ("walls", body("static"), 2), ("boxes", body(), 2), ("pushers", body("driven", sphere=True), 1),
        ("balls", body(sphere=True), 1), robot=pusher(), gravity=WEIGHTLESS, ground=False,
    )  # fmt: skip
    place = np.array([[[i + 1.0, -2.0 * i, 1.0 + 0.1 * i] for i in range(6)]] * 2)
    place[1] += 0.5
    with running(backend, scene, 2, body_position=place, body_quaternion=SKEW) as world:
        reset = world.state()
        world.step(idle(world), 1)
        state = world.state()
    sign = np.sign(reset.body_quaternion @ SKEW)[..., None]
    return [
        error("positions after reset", reset.body_position, place, rounding(backend, 10.0), "m"),
        error("quaternions after reset", sign * reset.body_quaternion, np.broadcast_to(SKEW, (2, 6, 4)),
              rounding(backend)),
        error("positions after a step at rest", state.body_position, place, rounding(backend, 10.0), "m"),
        count("arrays that differ from the contract", _misshapen(state, scene, 2)),
    ]  # fmt: skip


@check("C2")
def scene_without_robot(backend: Backend) -> list[Finding]:
    """A scene without a robot builds and its robot arrays are empty."""
    scene = bodies_scene(("boxes", body(), 3))
    start = rest_start(scene, 2, body_position=[[0, 0, 1], [1, 0, 1], [2, 0, 1]])
    with running(backend, scene, 2, body_position=start.body_position) as world:
        world.step(idle(world), 2)
        return [count("arrays that differ from the contract", _misshapen(world.state(), scene, 2))]


def _misshapen(state: State, scene: SceneSpec, num_worlds: int) -> list[str]:
    shapes = state_shapes(scene, num_worlds)
    names = [item.name for item in fields(State)]
    return [n for n in names if getattr(state, n).shape != shapes[n] or getattr(state, n).dtype != state_dtype(n)]
