"""C6: thrusters, step by step against their formula: point, direction, offset and ceiling."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

import numpy as np

from guard_api import rotations
from guard_api.model.robot import Actuator
from guard_api.physics.backend import Backend
from guard_api.testing.checks.check import Finding, check, count, error, rounding
from guard_api.testing.scenes import TIMESTEP, idle, loose_link, robot_scene, running

STEPS = 40
G = 9.81
EARTH = (0.0, 0.0, -G)


@check("C6")
def thrust_law(backend: Backend) -> list[Finding]:
    """A thruster pushes at its point, along its direction, in link axes, clipped; the torque is about the com.

    One substep from rest: v_com = h F / m and w = h (r x F) / I; the origin's velocity is v_com - w x com, up to the
    turn during the substep, h |w|^2 |com|.
    """
    com, point, mass, inertia = np.array([0.05, -0.02, 0.03]), np.array([0.1, 0.2, -0.1]), 2.0, 0.02
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    thruster = Actuator(
        name="jet", law="thrust", link="hull", point=tuple(point), direction=tuple(direction), gear=10.0,
        effort_limit=4.0,
    )  # fmt: skip
    turn = np.array([0.1, -0.5, 0.7, 0.5]) / np.linalg.norm([0.1, -0.5, 0.7, 0.5])
    findings = []
    for control, force in ((0.3, 3.0), (0.9, 4.0), (-7.0, -4.0)):
        robot = loose_link(com=tuple(com), mass=mass, inertia=inertia, actuators=(thruster,))
        with running(backend, robot_scene(robot), base_quaternion=turn) as world:
            world.step(np.array([[control]]), 1)
            state = world.state()
        push = force * direction
        angular = rotations.rotate(turn, TIMESTEP * np.cross(point - com, push) / inertia)
        linear = rotations.rotate(turn, TIMESTEP * push / mass) - np.cross(angular, rotations.rotate(turn, com))
        noise = rounding(backend, 0.1)
        during = TIMESTEP * float(angular @ angular) * float(np.linalg.norm(com))
        findings += [
            error(f"angular velocity, control {control}", state.link_angular_velocity[0, 0], angular, noise, "rad/s"),
            error(f"velocity, control {control}", state.link_linear_velocity[0, 0], linear, noise + during, "m/s"),
        ]
    return findings


@check("C6")
def thrust_turns_with_the_link(backend: Backend) -> list[Finding]:
    """A thrust turns with its link during a step: the velocity is the sum over the substeps' orientations.

    A ball with equal moments of inertia keeps its spin w exactly; v = (F h / m) sum_n (cos w n h, sin w n h), with an
    orientation at most one substep off: w h of the whole.
    """
    spin, force, mass = 6.0, 3.0, 2.0
    jet = Actuator(name="jet", law="thrust", link="hull", direction=(1.0, 0.0, 0.0), gear=force)
    robot = loose_link(mass=mass, actuators=(jet,))
    with running(backend, robot_scene(robot), base_angular_velocity=(0.0, 0.0, spin)) as world:
        world.step(np.array([[1.0]]), STEPS)
        state = world.state()
    angle = spin * TIMESTEP * np.arange(STEPS)
    gain = force * TIMESTEP / mass
    expected = gain * np.array([np.cos(angle).sum(), np.sin(angle).sum(), 0.0])
    tolerance = gain * STEPS * spin * TIMESTEP
    unturned = float(np.abs(expected - [gain * STEPS, 0.0, 0.0]).max())
    return [
        error("velocity", state.link_linear_velocity[0, 0], expected, tolerance, "m/s"),
        count("the check cannot tell a turning thrust from a fixed one", int(unturned < 10 * tolerance)),
    ]


def hovering(*, effort_limit: float = np.inf, ceiling: float = np.inf) -> tuple[Actuator, ...]:
    """Return two jets that push up beside the com of a 2 kg link; each carries half of its weight at control 0."""
    rims = ((0.3, 0.0, 0.0), (-0.3, 0.0, 0.0))
    return tuple(
        Actuator(
            name=f"jet{i}",
            law="thrust",
            link="hull",
            point=rim,
            gear=4.0,
            offset=G,
            effort_limit=effort_limit,
            ceiling=ceiling,
        )
        for i, rim in enumerate(rims)
    )


@check("C6")
def thrust_offset(backend: Backend) -> list[Finding]:
    """The force of a thrust is clip(gear u + offset): a robot hovers at control 0, and rises up to the limit."""
    findings = []
    for control, force in ((0.0, 2 * G), (0.25, 2 * (G + 1.0)), (1.0, 2 * (G + 2.0)), (-1.0, 2 * (G - 4.0))):
        robot = loose_link(actuators=hovering(effort_limit=G + 2.0))
        with running(backend, robot_scene(robot, gravity=EARTH), base_position=(0.0, 0.0, 1.0)) as world:
            world.step(idle(world) + control, STEPS)
            state = world.state()
        speed = STEPS * TIMESTEP * (force / 2.0 - G)
        noise = rounding(backend, G * TIMESTEP, STEPS)
        what = f"velocity, control {control}"
        findings.append(error(what, state.link_linear_velocity[0, 0], [0.0, 0.0, speed], noise, "m/s"))
    return findings


@check("C6")
def thrust_ceiling(backend: Backend) -> list[Finding]:
    """Above its ceiling a thrust loses its offset, for the whole of a step at whose beginning the link was above it.

    Four worlds: below; above; below but above it after one substep, which only the next step minds; above but falling.
    """
    robot = loose_link(com=(0.0, 0.0, 0.2), actuators=hovering(ceiling=3.0))
    height, speed = np.array([2.9, 3.1, 2.999, 3.001]), np.array([0.0, 0.0, 2.0, -2.0])
    place = np.zeros((4, 3)), np.zeros((4, 3))
    place[0][:, 2], place[1][:, 2] = height, speed
    noise, findings = rounding(backend, 3.0, 2 * STEPS), []
    with running(
        backend, robot_scene(robot, gravity=EARTH), 4, base_position=place[0], base_linear_velocity=place[1]
    ) as world:
        for step in ("first", "second"):
            fall = np.where(height > 3.0, -G, 0.0)
            height = height + STEPS * TIMESTEP * (speed + (STEPS + 1) / 2 * TIMESTEP * fall)
            speed = speed + STEPS * TIMESTEP * fall
            world.step(idle(world), STEPS)
            state = world.state()
            findings += [
                error(f"height after the {step} step", state.link_position[:, 0, 2], height, noise, "m"),
                error(f"speed after the {step} step", state.link_linear_velocity[:, 0, 2], speed, noise, "m/s"),
            ]
    return findings
