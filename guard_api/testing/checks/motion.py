"""C12 without contacts: falls, swings, servos and stops against theory."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

import numpy as np

from guard_api.model.dynamics import Dynamics
from guard_api.model.robot import Actuator
from guard_api.physics.backend import Backend
from guard_api.testing.checks.check import Finding, check, error, rounding
from guard_api.testing.checks.mechanics import GRAVITY
from guard_api.testing.scenes import (
    TIMESTEP,
    WEIGHTLESS,
    bodies_scene,
    body,
    effort_actuator,
    idle,
    loose_link,
    one_joint,
    pendulum,
    robot_scene,
    running,
    tree,
)

G = 9.81
EARTH = (0.0, 0.0, -G)
MASS, LENGTH, INERTIA = 2.0, 0.5, 0.05


@check("C12")
def free_fall(backend: Backend) -> list[Finding]:
    """A robot in flight falls by n (n + 1) g h^2 / 2 in n steps, which is semi-implicit Euler, and keeps its course."""
    steps = 250
    with running(backend, robot_scene(loose_link(), gravity=EARTH), base_linear_velocity=(1.5, 0, 2)) as world:
        world.step(idle(world), steps)
        state = world.state()
    time = steps * TIMESTEP
    place = [1.5 * time, 0.0, 2.0 * time - steps * (steps + 1) * G * TIMESTEP**2 / 2]
    noise = rounding(backend, 5.0, steps, operations=4)
    return [
        error("position after 0.5 s", state.link_position[0, 0], place, noise, "m"),
        error("velocity after 0.5 s", state.link_linear_velocity[0, 0], [1.5, 0.0, 2.0 - G * time], noise, "m/s"),
    ]


@check("C12")
def free_fall_of_bodies(backend: Backend) -> list[Finding]:
    """Dynamic bodies fall like robots, past 10 m/s, and spin on undamped."""
    steps, spin = 750, 8.0
    scene = bodies_scene(("balls", body(sphere=True), 1), ground=False)
    with running(backend, scene, body_angular_velocity=(0, 0, spin)) as world:
        world.step(idle(world), steps)
        state = world.state()
    time = steps * TIMESTEP
    noise = rounding(backend, 15.0, steps, operations=4)
    return [
        error("height after 1.5 s", state.body_position[0, 0, 2], -steps * (steps + 1) * G * TIMESTEP**2 / 2, noise),
        error("speed after 1.5 s", state.body_linear_velocity[0, 0], [0.0, 0.0, -G * time], noise, "m/s"),
        error("spin after 1.5 s", state.body_angular_velocity[0, 0], [0.0, 0.0, spin], noise, "rad/s"),
    ]


@check("C12")
def damping_of_bodies(backend: Backend) -> list[Finding]:
    """Dynamic bodies lose their linear and angular velocities as exp(-c t), whatever their mass, and only damped ones.

    The way is the sum of the velocities after each step, h v e^-ch (1 - e^-cT) / (1 - e^-ch). Under gravity a damped
    body stops gaining speed at g / c; the order of pull and damping within a step is free, a relative c h of it.
    """
    steps, rate = 500, 2.0
    speed, spin = np.array([3.0, -1.0, 0.5]), 5.0
    light, plain = body(mass=0.01, damping=rate), body()
    scene = bodies_scene(("light", light, 1), ("plain", plain, 1), ground=False, gravity=WEIGHTLESS)
    start = {
        "body_linear_velocity": speed,
        "body_angular_velocity": (0, 0, spin),
        "body_position": [(0,) * 3, (9,) * 3],
    }
    with running(backend, scene, **start) as world:
        world.step(idle(world), steps)
        state = world.state()
    left, decay = np.exp(-rate * steps * TIMESTEP), np.exp(-rate * TIMESTEP)
    way = TIMESTEP * speed * decay * (1.0 - left) / (1.0 - decay)
    noise = rounding(backend, 5.0, steps, operations=4)
    falling = bodies_scene(("light", light, 1), ground=False, gravity=EARTH)
    with running(backend, falling) as world:
        world.step(idle(world), 10 * steps)
        terminal = world.state().body_linear_velocity[0, 0, 2]
    return [
        error("velocity after 1 s", state.body_linear_velocity[0, 0], left * speed, noise, "m/s"),
        error("spin after 1 s", state.body_angular_velocity[0, 0], [0.0, 0.0, left * spin], noise, "rad/s"),
        error("way after 1 s", state.body_position[0, 0], way, noise, "m"),
        error("velocity of the undamped one", state.body_linear_velocity[0, 1], speed, noise, "m/s"),
        error("speed of a long fall", terminal, -G / rate, 2 * rate * TIMESTEP * G / rate, "m/s"),
    ]


@check("C12")
def no_speed_limits(backend: Backend) -> list[Finding]:
    """Fast joints stay fast: no engine default caps or brakes 200 rad/s."""
    with running(backend, robot_scene(one_joint("continuous")), joint_velocity=200.0) as world:
        world.step(idle(world), 250)
        speed = world.state().joint_velocity[0, 0]
    return [error("speed of a coasting hinge", speed, 200.0, rounding(backend, 200.0, 250, operations=4), "rad/s")]


@check("C12")
def pendulum_swing(backend: Backend) -> list[Finding]:
    """A pendulum let go at 1 rad keeps its period and its energy.

    The period is 2 pi / (w agm(1, cos(a / 2))), amplitude a, frequency w of small swings. Semi-implicit Euler shortens
    it by (w h)^2 / 24 relative, and the crossings are interpolated, wrong by O((w h)^2) too. It conserves
    H - (h / 2) qd dV/dq + O(h^2), so the energy spreads by h max |qd dV/dq|; 10 % are granted for the O(h^2).
    Source: Hairer, Lubich and Wanner 2006, Geometric Numerical Integration, section IX.3 (modified Hamiltonian).
    """
    amplitude, inertia = 1.0, INERTIA + MASS * LENGTH**2
    natural = (MASS * G * LENGTH / inertia) ** 0.5
    period = 2 * np.pi / (natural * _agm(1.0, np.cos(amplitude / 2)))
    q, qd = np.empty((2, int(0.8 * period / TIMESTEP)))
    with running(
        backend, robot_scene(pendulum(MASS, LENGTH, INERTIA), gravity=EARTH), joint_position=amplitude
    ) as world:
        for i in range(len(q)):
            state = world.state()
            q[i], qd[i] = state.joint_position[0, 0], state.joint_velocity[0, 0]
            world.step(idle(world), 1)
    fall, rise = np.flatnonzero(np.diff(np.sign(q)))[:2]
    first, second = (i + q[i] / (q[i] - q[i + 1]) for i in (fall, rise))
    energy = inertia * qd**2 / 2 - MASS * G * LENGTH * np.cos(q)
    power = float(np.abs(qd * MASS * G * LENGTH * np.sin(q)).max())
    noise = rounding(backend, 10.0, len(q), operations=4)
    return [
        error("period", 2 * (second - first) * TIMESTEP, period, period * (natural * TIMESTEP) ** 2 + noise, "s"),
        error("spread of the energy", np.ptp(energy), 0.0, 1.1 * TIMESTEP * power + noise, "J"),
    ]


def _agm(a: float, b: float) -> float:
    """Return the arithmetic-geometric mean, to rounding after five rounds for numbers of one magnitude."""
    for _ in range(5):
        a, b = (a + b) / 2, (a * b) ** 0.5
    return a


@check("C12")
def chain_trajectory(backend: Backend) -> list[Finding]:
    """A driven, damped, branched robot moves for 0.2 s as the reference recursion does.

    The floor of contact-free motion over seconds is 1e-14 in float64 and 1e-4 in float32; 1e-9 leaves room for the
    order of sums in an ill-conditioned mass matrix.
    """
    robot = tree("fixed", armature=0.02, damping=0.3)
    q = 0.1 * np.arange(5.0)[None]
    qd = np.zeros((1, 5))
    columns = [robot.joint_index(str(actuator.joint)) for actuator in robot.actuators]
    dynamics, origin = Dynamics(robot, GRAVITY), np.zeros((1, 3))
    upright = np.array([[1.0, 0.0, 0.0, 0.0]])
    with running(backend, robot_scene(robot, gravity=GRAVITY), joint_position=q[0]) as world:
        for i in range(100):
            control = np.sin(0.1 * i + np.arange(5.0))[None]
            world.step(control, 1)
            effort = np.empty((1, 5))
            effort[:, columns] = control
            poses = dynamics.kinematics.poses(origin, upright, q)
            acceleration = dynamics.acceleration(
                poses, origin, origin, qd, effort=effort, thrust=np.zeros((1, 0, 3)), timestep=TIMESTEP
            )
            qd = qd + TIMESTEP * acceleration
            q = q + TIMESTEP * qd
        state = world.state()
    tolerance = 1e-4 if backend.capabilities.precision == "float32" else 1e-9
    return [
        error("joint positions", state.joint_position, q, tolerance, "rad, m"),
        error("joint velocities", state.joint_velocity, qd, 10 * tolerance, "rad/s, m/s"),
    ]


@check("C12")
def servo_response(backend: Backend) -> list[Finding]:
    """A position servo steps like a second-order system: its overshoot and the time of its peak.

    Overshoot exp(-z pi / sqrt(1 - z^2)) at pi / (w sqrt(1 - z^2)), natural frequency w, damping ratio z.

    Semi-implicit Euler with an explicit kd is first order: the damping ratio is off by w h / 2 or less, the overshoot
    by that times its derivative (< pi), the time by one step and a relative w h.
    """
    inertia, kp, kd = 0.05, 20.0, 0.6
    natural, ratio = (kp / inertia) ** 0.5, kd / (2 * (kp * inertia) ** 0.5)
    root = (1 - ratio**2) ** 0.5
    servo = Actuator(name="servo", law="position", joint="joint", kp=kp, kd=kd)
    angles = np.empty(150)
    with running(backend, robot_scene(one_joint("continuous", inertia=inertia, actuators=(servo,)))) as world:
        for i in range(len(angles)):
            world.step(np.array([[1.0]]), 1)
            angles[i] = world.state().joint_position[0, 0]
    first_order = natural * TIMESTEP
    peak, when = np.pi / (natural * root), float((np.argmax(angles) + 1) * TIMESTEP)
    overshoot = np.exp(-np.pi * ratio / root)
    return [
        error("overshoot", angles.max() - 1.0, overshoot, np.pi * first_order / 2, "rad"),
        error("time of the peak", when, peak, TIMESTEP + peak * first_order, "s"),
    ]


@check("C12")
def servo_droop(backend: Backend) -> list[Finding]:
    """A position servo under gravity comes to rest where kp (target - q) carries the weight."""
    kp, mass = 2000.0, 2.0
    servo = Actuator(name="servo", law="position", joint="joint", kp=kp, kd=2.0 * (kp * mass) ** 0.5)
    robot = one_joint(axis=(0.0, 0.0, 1.0), mass=mass, actuators=(servo,))
    with running(backend, robot_scene(robot, gravity=EARTH)) as world:
        world.step(np.array([[0.2]]), 750)
        state = world.state()
    # Critically damped at 32 rad/s: after 1.5 s the transient is (1 + 48) e^-48, below rounding.
    noise = rounding(backend, operations=64)
    return [
        error("rest position", state.joint_position[0, 0], 0.2 - mass * G / kp, noise, "m"),
        error("effort at rest", state.joint_effort[0, 0], mass * G, kp * noise, "N"),
    ]


@check("C12")
def joint_stops(backend: Backend) -> list[Finding]:
    """A joint stops at its limits, without bouncing, and holds there against its drive.

    A time-stepping engine sees the limit at the end of a step at the earliest: it may pass by one step of travel, v h.
    The rebound of a constraint that is critically damped over two timesteps is below 2 % of the speed. Under an effort
    it gives by (1 - d) (2 h)^2 effort / I, at an impedance d of 90 % or more; a hard stop gives nothing.
    """
    effort, inertia = 20.0, 0.05
    give = 0.1 * (2 * TIMESTEP) ** 2 * effort / inertia
    speed, limit = 2.0, 0.3
    robot = one_joint("revolute", inertia=inertia, limits=(-limit, limit), actuators=(effort_actuator(),))
    findings = []
    for sign, name in ((1.0, "upper"), (-1.0, "lower")):
        q, qd = np.empty(120), np.empty(120)
        with running(backend, robot_scene(robot), joint_velocity=sign * speed) as world:
            for i in range(len(q)):
                world.step(idle(world), 1)
                state = world.state()
                q[i], qd[i] = sign * state.joint_position[0, 0], sign * state.joint_velocity[0, 0]
            world.step(idle(world) + sign * effort, 150)
            held = world.state()
        findings += [
            Finding(what=f"overshoot at the {name} limit", value=float(q.max() - limit), tolerance=speed * TIMESTEP,
                    unit="rad"),
            Finding(what=f"rebound from the {name} limit", value=float(-qd.min()), tolerance=0.02 * speed,
                    unit="rad/s"),
            error(f"position held at the {name} limit", sign * held.joint_position[0, 0], limit, give, "rad"),
            error(f"speed held at the {name} limit", held.joint_velocity[0, 0], 0.0, 1e-3, "rad/s"),
        ]  # fmt: skip
    return findings


@check("C12")
def limits_do_not_brake(backend: Backend) -> list[Finding]:
    """Between its limits a limited joint coasts freely, beyond a full turn too."""
    robot = one_joint("revolute", limits=(-20.0, 20.0))
    with running(backend, robot_scene(robot, gravity=WEIGHTLESS), joint_velocity=20.0) as world:
        world.step(idle(world), 400)
        state = world.state()
    noise = rounding(backend, 20.0, 400, operations=4)
    return [
        error("angle after 0.8 s", state.joint_position[0, 0], 16.0, noise, "rad"),
        error("speed after 0.8 s", state.joint_velocity[0, 0], 20.0, noise, "rad/s"),
    ]
