"""C3 and C4: where links are, how they move, and what the engine believes they weigh, against the neutral model."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guard_api.model.dynamics import Dynamics
from guard_api.model.kinematics import Kinematics, LinkPoses
from guard_api.model.robot import BaseKind, RobotModel
from guard_api.physics.backend import Backend, World
from guard_api.physics.state import Inspection, State
from guard_api.testing.checks.check import Finding, check, count, error, moment_of_weights, rounding, worst
from guard_api.testing.scenes import TIMESTEP, bodies_scene, body, idle, rest_start, robot_scene, running, tree

Array = NDArray[np.float64]

GRAVITY = (0.5, -1.0, -9.0)
"""Not along an axis, so that no component of a gravity torque is zero by symmetry."""

INERTIAL = 1e-6
"""Relative tolerance of masses, inertias and what follows from them in the contract (C4)."""

WORLDS = 4
"""Random configurations that are looked at together."""

BASES: tuple[BaseKind, ...] = ("floating", "fixed", "planar")


def laden_tree(base: BaseKind) -> RobotModel:
    """Return the branched robot with armature, damping and a spring on every joint."""
    return tree(base, armature=0.02, damping=0.3, stiffness=4.0, rest_position=0.2)


def anywhere(robot: RobotModel, num_worlds: int = WORLDS) -> dict[str, ArrayLike]:
    """Return random poses within the joint limits, and velocities where the base may have them."""
    rng = np.random.default_rng(11)
    limits = np.array([joint.limits or (-np.inf, np.inf) for joint in robot.joints]).reshape(-1, 2)
    # No limit comes into play within a substep, in which a joint crosses a fifth of the margin.
    margin = np.minimum(0.02, 0.25 * (limits[:, 1] - limits[:, 0]))
    speed = 100.0 * margin
    lower, upper = limits[:, 0] + margin, limits[:, 1] - margin
    near = np.clip(0.0, lower, upper)
    lower, upper = np.maximum(lower, near - 1.0), np.minimum(upper, near + 1.0)
    start: dict[str, ArrayLike] = {
        "joint_position": rng.uniform(lower, upper, (num_worlds, len(robot.joints))),
        "joint_velocity": rng.uniform(-speed, speed, (num_worlds, len(robot.joints))),
    }
    if robot.base != "planar":
        quaternion = rng.normal(size=(num_worlds, 4))
        start["base_position"] = rng.normal(size=(num_worlds, 3))
        start["base_quaternion"] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    if robot.floating:
        start["base_linear_velocity"] = rng.normal(size=(num_worlds, 3))
        start["base_angular_velocity"] = rng.normal(size=(num_worlds, 3))
    return start


def reference(robot: RobotModel, state: State) -> tuple[LinkPoses, Array, Array]:
    """Return what the neutral kinematics makes of the base and joints of `state`: poses, linear, angular velocity."""
    kinematics = Kinematics(robot)
    poses = kinematics.poses(state.link_position[:, 0], state.link_quaternion[:, 0], state.joint_position)
    linear, angular = kinematics.velocities(
        poses, state.link_linear_velocity[:, 0], state.link_angular_velocity[:, 0], state.joint_velocity
    )
    return poses, linear, angular


def _compare_links(backend: Backend, robot: RobotModel, state: State, when: str) -> list[Finding]:
    poses, linear, angular = reference(robot, state)
    sign = np.sign(np.sum(poses.quaternion * state.link_quaternion, axis=-1, keepdims=True))
    speed = max(1.0, float(np.abs(linear).max()), float(np.abs(angular).max()))
    return [
        error(f"link positions {when}", state.link_position, poses.position, rounding(backend, 2.0), "m"),
        error(f"link quaternions {when}", sign * state.link_quaternion, poses.quaternion, rounding(backend)),
        error(
            f"velocities of link origins {when}", state.link_linear_velocity, linear, rounding(backend, speed), "m/s"
        ),
        error(f"angular velocities {when}", state.link_angular_velocity, angular, rounding(backend, speed), "rad/s"),
    ]


@check("C3")
def links_after_reset(backend: Backend) -> list[Finding]:
    """Right after a reset, links stand and move as the kinematics of base and joints say: link origins, world axes."""
    return [finding for base in BASES for finding in reset_links(backend, laden_tree(base))]


def reset_links(backend: Backend, robot: RobotModel, rounds: int = 1) -> list[Finding]:
    """Compare the links of `robot` right after a reset with its kinematics, and its base with the start."""
    findings = []
    for world, start in placed(backend, robot, rounds):
        state = world.state()
        findings += _compare_links(backend, robot, state, f"({robot.base} base)")
        for name in ("position", "quaternion", "linear_velocity", "angular_velocity"):
            if f"base_{name}" in start:
                got, expected = getattr(state, f"link_{name}")[:, 0], start[f"base_{name}"]
                sign = np.sign(np.sum(got * expected, axis=1, keepdims=True)) if name == "quaternion" else 1.0
                findings.append(error(f"{name} of the {robot.base} base", sign * got, expected, rounding(backend, 2.0)))
    return worst(findings)


@check("C3")
def links_after_motion(backend: Backend) -> list[Finding]:
    """After motion too, poses and velocities of links and joints belong to one instant."""
    findings = []
    for base in BASES:
        robot = laden_tree(base)
        with running(backend, robot_scene(robot, gravity=GRAVITY), 4, **anywhere(robot)) as world:
            world.step(idle(world) + 0.5, 25)
            findings += _compare_links(backend, robot, world.state(), f"({base} base)")
    return findings


@check("C3")
def velocities_are_derivatives(backend: Backend) -> list[Finding]:
    """Positions change by the velocities reported: dq = h qd exactly, link origins within the change of velocity.

    A velocity of the com instead of the link origin is off by angular velocity times com, far more than one step adds.
    """
    robot = tree()
    with running(backend, robot_scene(robot), 4, **anywhere(robot)) as world:
        before = world.state()
        world.step(idle(world), 1)
        after = world.state()
    dq = (after.joint_position - before.joint_position) / TIMESTEP
    dp = (after.link_position - before.link_position) / TIMESTEP
    # A difference quotient magnifies the rounding of positions by 1/h.
    noise = rounding(backend, 2.0, operations=8) / TIMESTEP
    change = np.abs(after.link_linear_velocity - before.link_linear_velocity).max()
    return [
        error("joints (semi-implicit Euler)", dq, after.joint_velocity, noise, "rad/s, m/s"),
        error("link origins", dp, after.link_linear_velocity, float(change) + noise, "m/s"),
    ]


@check("C4")
def link_inertials(backend: Backend) -> list[Finding]:
    """Masses, centres of mass and inertias that the engine holds are the model's, to 1e-6."""
    return [finding for base in BASES for finding in held_inertials(backend, laden_tree(base))]


def held_inertials(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Compare what the engine holds for the links of `robot` with the model."""
    held = next(_inspected(backend, robot, 1))[1]
    # A welded root never moves: what an engine holds for it means nothing. Massless links hold a stand-in.
    rows = [i for i, link in enumerate(robot.links) if not link.virtual and (i > 0 or robot.floating)]
    mass = np.array([robot.links[i].mass for i in rows])
    com = np.array([robot.links[i].com for i in rows])
    inertia = np.array([robot.links[i].inertia for i in rows])
    scale = np.abs(inertia).max(axis=(1, 2), keepdims=True)
    base = f"({robot.base} base)"
    return [
        error(f"mass {base}", held.link_mass[rows] / mass, 1.0, INERTIAL, "relative"),
        error(f"centre of mass {base}", held.link_com[rows], com, INERTIAL, "m"),
        error(f"inertia {base}", held.link_inertia[rows] / scale, inertia / scale, INERTIAL, "relative"),
    ]


@check("C4")
def body_masses(backend: Backend) -> list[Finding]:
    """Dynamic bodies weigh what their spec says; the others read 0."""
    scene = bodies_scene(("boxes", body(mass=3.0), 2), ("walls", body("static"), 1), ("cars", body("driven"), 1))
    with running(backend, scene, body_position=[[i, 0, 1] for i in range(4)]) as world:
        return [error("body mass", world.inspect(0).body_mass, [3.0, 3.0, 0.0, 0.0], 3 * INERTIAL, "kg")]


@check("C4")
def mass_matrix(backend: Backend) -> list[Finding]:
    """The engine's mass matrix of fixed and planar robots, armature included, is that of the reference recursion."""
    return [held_mass_matrix(backend, laden_tree(base)) for base in ("fixed", "planar")]


@check("C4")
def floating_mass_matrix(backend: Backend) -> list[Finding]:
    """The engine's mass matrix of a floating robot, base coordinates first, is that of the reference recursion."""
    return [held_mass_matrix(backend, laden_tree("floating"))]


@check("C4")
def bias_force(backend: Backend) -> list[Finding]:
    """The engine's Coriolis and gravity force on fixed and planar robots is that of the reference recursion."""
    return [held_bias_force(backend, laden_tree(base)) for base in ("fixed", "planar")]


@check("C4")
def floating_bias_force(backend: Backend) -> list[Finding]:
    """The engine's Coriolis and gravity force on a floating robot is that of the reference recursion."""
    return [held_bias_force(backend, laden_tree("floating"))]


def held_mass_matrix(backend: Backend, robot: RobotModel, rounds: int = 1) -> Finding:
    """Compare the engine's mass matrix of `robot` with the reference recursion's."""
    dynamics, got, expected = Dynamics(robot, GRAVITY), [], []
    for state, held in _inspected(backend, robot, rounds):
        if held.mass_matrix is None:
            return count("mass matrices that the engine cannot say", 1)
        got.append(held.mass_matrix)
        expected.append(dynamics.mass_matrix(reference(robot, state)[0])[0])
    return error(f"mass matrix ({robot.base} base)", got, expected, inertial_tolerance(backend, expected), "kg, kg m^2")


def held_bias_force(backend: Backend, robot: RobotModel, rounds: int = 1) -> Finding:
    """Compare the engine's bias force on `robot` with the reference recursion's."""
    dynamics, got, expected, moments = Dynamics(robot, GRAVITY), [], [], []
    for state, held in _inspected(backend, robot, rounds):
        if held.bias_force is None:
            return count("bias forces that the engine cannot say", 1)
        poses, linear, angular = reference(robot, state)
        got.append(held.bias_force)
        expected.append(dynamics.bias_force(poses, linear[:, 0], angular[:, 0], state.joint_velocity)[0])
        moments.append(moment_of_weights(robot, state.link_position[0]))
    tolerance = inertial_tolerance(backend, expected) + rounding(backend, max(moments), operations=64)
    return error(f"bias force ({robot.base} base)", got, expected, tolerance, "N, N m")


def _inspected(backend: Backend, robot: RobotModel, rounds: int) -> Iterator[tuple[State, Inspection]]:
    """Yield state and inspection of a moving robot at random configurations, `WORLDS` a round, in one world."""
    for world, _ in placed(backend, robot, rounds * WORLDS, num_worlds=1, gravity=GRAVITY):
        yield world.state(), world.inspect(0)


def placed(
    backend: Backend, robot: RobotModel, rounds: int, *, num_worlds: int = WORLDS, **scene: Any
) -> Iterator[tuple[World, dict[str, Array]]]:
    """Yield the same worlds of `robot`, right after each of `rounds` resets to random configurations, and the start."""
    spec, places = robot_scene(robot, **scene), anywhere(robot, rounds * num_worlds)
    with running(backend, spec, num_worlds) as world:
        for first in range(0, rounds * num_worlds, num_worlds):
            start = {name: np.asarray(value)[first : first + num_worlds] for name, value in places.items()}
            world.reset(np.ones(num_worlds, dtype=bool), rest_start(spec, num_worlds, **start))
            yield world, start


def inertial_tolerance(backend: Backend, expected: ArrayLike) -> float:
    """Return the absolute tolerance of a quantity that follows from the inertias, by its largest component."""
    # 1024 operations: an elimination squares the sums behind one number.
    return max(INERTIAL, rounding(backend, operations=1024)) * float(np.abs(np.asarray(expected)).max())
