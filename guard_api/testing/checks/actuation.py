"""C6: the actuation law of one joint and of thrusters, step by step against its formula."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from guard_api.model.robot import Actuator, RobotModel
from guard_api.physics.backend import Backend
from guard_api.testing.checks.check import Finding, check, error, rounding
from guard_api.testing.scenes import TIMESTEP, effort_actuator, idle, one_joint, robot_scene, running

STEPS = 40


def servo(law: str, **values: float | tuple[float, float]) -> Actuator:
    """Return an actuator on the only joint."""
    return Actuator(name="servo", law=law, joint="joint", **values)  # type: ignore[arg-type]


def written_effort(robot: RobotModel, control: NDArray[np.float64], q: float, qd: float) -> float:
    """Return the joint effort by the formulas of `guard_api.physics.actuation`, written again in scalars."""
    total = 0.0
    for actuator, value in zip(robot.actuators, control, strict=True):
        target = actuator.gear * min(max(value, actuator.ctrl_range[0]), actuator.ctrl_range[1])
        effort = target
        if actuator.law == "position":
            effort = actuator.kp * (target + actuator.offset - q) - actuator.kd * qd
        elif actuator.law == "velocity":
            effort = actuator.kd * (target + actuator.offset - qd)
        total += min(max(effort, -actuator.effort_limit), actuator.effort_limit)
    limit = robot.joints[0].effort_limit
    return min(max(total, -limit), limit)


def follows_law(backend: Backend, robot: RobotModel, amplitude: float = 1.0, what: str = "") -> list[Finding]:
    """Compare `STEPS` steps of a weightless one-joint robot with (I + a + h d) qdd = effort - d qd - k (q - rest)."""
    joint, link = robot.joints[0], robot.links[1]
    inertia = link.mass if joint.kind == "prismatic" else link.inertia[0][0]
    q, qd = 0.2, -0.4
    findings, errors, scale = [], np.zeros(3), np.ones(3)
    with running(backend, robot_scene(robot), joint_position=q, joint_velocity=qd) as world:
        for i in range(STEPS):
            control = amplitude * np.cos(0.2 * i + np.arange(len(robot.actuators)))
            effort = written_effort(robot, control, q, qd)
            whole = inertia + joint.armature + TIMESTEP * joint.damping
            spring = joint.stiffness * (joint.rest_position - q)
            qd += TIMESTEP * (effort + spring - joint.damping * qd) / whole
            q += TIMESTEP * qd
            world.step(control[None], 1)
            state = world.state()
            got = np.array([state.joint_position[0, 0], state.joint_velocity[0, 0], state.joint_effort[0, 0]])
            expected = np.array([q, qd, effort])
            # A NaN must survive the maximum.
            errors = np.where(np.isnan(got), np.nan, np.maximum(errors, np.abs(got - expected)))
            scale = np.maximum(scale, np.abs(expected))
    for name, value, size in zip(("position", "velocity", "effort"), errors, scale, strict=True):
        # A servo reads its joint: its effort inherits the joint's rounding times the gain.
        gain = 1.0 + (sum(a.kp + a.kd for a in robot.actuators) if name == "effort" else 0.0)
        tolerance = rounding(backend, float(size) * gain, STEPS, operations=16)
        findings.append(error(f"{name}{what}", value, 0.0, tolerance))
    return findings


@check("C6")
def effort_law(backend: Backend) -> list[Finding]:
    """Law "effort": gear times control, on hinges and sliders."""
    drive = servo("effort", gear=3.0)
    return [
        *follows_law(backend, one_joint("prismatic", actuators=(drive,)), what=" of a slider"),
        *follows_law(backend, one_joint("continuous", actuators=(drive,)), what=" of a hinge"),
    ]


@check("C6")
def velocity_law(backend: Backend) -> list[Finding]:
    """Law "velocity": kd (gear u + offset - qd)."""
    drive = servo("velocity", gear=2.0, offset=0.3, kd=5.0)
    return follows_law(backend, one_joint("continuous", actuators=(drive,)))


@check("C6")
def position_law(backend: Backend) -> list[Finding]:
    """Law "position": kp (gear u + offset - q) - kd qd."""
    drive = servo("position", gear=0.5, offset=0.1, kp=40.0, kd=2.0)
    return follows_law(backend, one_joint("continuous", actuators=(drive,)))


@check("C6")
def control_is_clipped(backend: Backend) -> list[Finding]:
    """The control is clipped to its range before the gear."""
    drive = servo("effort", gear=3.0, ctrl_range=(-0.2, 0.5))
    return follows_law(backend, one_joint(actuators=(drive,)), amplitude=10.0)


@check("C6")
def efforts_are_limited(backend: Backend) -> list[Finding]:
    """Each actuator's effort is clipped, then their sum on the joint."""
    one, both = servo("effort", gear=8.0, effort_limit=3.0), servo("position", kp=50.0, kd=1.0, effort_limit=4.0)
    return [
        *follows_law(backend, one_joint(actuators=(one,)), what=", actuator limit"),
        *follows_law(backend, one_joint(actuators=(one, both), effort_limit=5.0), what=", joint limit"),
    ]


@check("C6")
def damping_is_implicit(backend: Backend) -> list[Finding]:
    """Joint damping is implicit: stable and exact where an explicit one with h d / I = 3 explodes."""
    drive = servo("effort", gear=3.0)
    heavy = 3.0 * 0.05 / TIMESTEP
    return [
        *follows_law(backend, one_joint("continuous", actuators=(drive,), damping=0.8), what=", light damping"),
        *follows_law(backend, one_joint("continuous", actuators=(drive,), damping=heavy), what=", heavy damping"),
    ]


@check("C6")
def armature_adds_inertia(backend: Backend) -> list[Finding]:
    """Armature adds to the joint's inertia and nowhere else, with and without damping."""
    drive = servo("effort", gear=3.0)
    return [
        *follows_law(backend, one_joint("continuous", actuators=(drive,), armature=1.0), what=" of a hinge"),
        *follows_law(backend, one_joint(actuators=(drive,), armature=0.5, damping=4.0), what=" of a damped slider"),
    ]


@check("C6")
def spring_law(backend: Backend) -> list[Finding]:
    """A joint's spring adds -k (q - rest), explicit; it is no actuator's effort, and no effort limit clips it."""
    spring: dict[str, Any] = {"stiffness": 20.0, "rest_position": -0.3}
    drive = servo("effort", gear=3.0)
    return [
        *follows_law(backend, one_joint("continuous", actuators=(drive,), **spring), what=" of a hinge"),
        *follows_law(backend, one_joint(actuators=(drive,), damping=4.0, **spring), what=" of a damped slider"),
        *follows_law(backend, one_joint(actuators=(drive,), effort_limit=0.5, **spring), what=", joint limit"),
        *follows_law(backend, one_joint("continuous", **spring), what=" without an actuator"),
    ]


@check("C6")
def springs_swing_and_rest(backend: Backend) -> list[Finding]:
    """An undamped spring swings with its period, stiff on a light joint; a damped one rests at rest + effort / k.

    The semi-implicit swing from rest is A cos((n + 1/2) phi) / cos(phi / 2) with 2 sin(phi / 2) = h sqrt(k / I).
    """
    k, inertia, h, rest, steps = 20.0, 0.0105, 0.003, 0.4, 500
    robot = one_joint("revolute", inertia=0.0005, armature=0.01, stiffness=k, rest_position=rest)
    with running(backend, robot_scene(robot, timestep=h), joint_position=0.0) as world:
        world.step(idle(world), steps)
        swing = world.state().joint_position[0, 0]
    phi = 2 * np.arcsin(h * np.sqrt(k / inertia) / 2)
    expected = rest - rest * np.cos((steps + 0.5) * phi) / np.cos(phi / 2)
    drive = servo("effort", gear=2.0)
    robot = one_joint(mass=0.05, damping=2.0, stiffness=k, rest_position=rest, actuators=(drive,))
    with running(backend, robot_scene(robot), joint_velocity=1.0) as world:
        world.step(idle(world) + 1.0, 500)
        still = world.state()
    noise = rounding(backend, 1.0, steps, operations=16)
    return [
        error("position after 10 swings", swing, expected, noise, "rad"),
        # In float32 a position stops changing at speeds of a rounding unit per timestep, here 3e-5 m/s.
        error("position at rest", still.joint_position[0, 0], rest + 2.0 / k, 1e-4, "m"),
        error("speed at rest", still.joint_velocity[0, 0], 0.0, 1e-4, "m/s"),
    ]


@check("C6")
def law_at_every_substep(backend: Backend) -> list[Finding]:
    """A servo is evaluated at every substep: k substeps under one control equal the recursion, not one held effort."""
    kp, kd, q, qd = 40.0, 2.0, 0.3, 0.0
    robot = one_joint("continuous", actuators=(servo("position", kp=kp, kd=kd),))
    with running(backend, robot_scene(robot), joint_position=q) as world:
        world.step(np.array([[0.5]]), STEPS)
        state = world.state()
    effort = 0.0
    for _ in range(STEPS):
        effort = kp * (0.5 - q) - kd * qd
        qd += TIMESTEP * effort / 0.05
        q += TIMESTEP * qd
    tolerance = rounding(backend, 10.0, STEPS, operations=16)
    return [
        error("joint position", state.joint_position[0, 0], q, tolerance, "rad"),
        error("effort of the last substep", state.joint_effort[0, 0], effort, kp * tolerance, "N m"),
    ]


@check("C6")
def dry_friction(backend: Backend) -> list[Finding]:
    """A joint with dry friction f sticks under f and slides with effort - f above it.

    Engines hold the joint by a stiff constraint, not a lock: under half the friction it may creep at 1 mm/s, which is
    what a constraint with a time constant of two timesteps and 95 % impedance does at 1 m/s^2. The slide is Coulomb's
    law to 1 %.
    """
    friction, mass = 4.0, 2.0
    robot = one_joint(mass=mass, actuators=(effort_actuator(),), friction_loss=friction)
    with running(backend, robot_scene(robot)) as world:
        world.step(idle(world) + 0.5 * friction, 100)
        creep = abs(world.state().joint_velocity[0, 0])
    with running(backend, robot_scene(robot)) as world:
        world.step(idle(world) + 2.0 * friction, 100)
        slide = world.state().joint_velocity[0, 0]
    expected = 100 * TIMESTEP * friction / mass
    return [
        Finding(what="creep at half the friction", value=float(creep), tolerance=1e-3, unit="m/s"),
        error("speed after 0.2 s at twice the friction", slide, expected, 0.01 * expected, "m/s"),
    ]
