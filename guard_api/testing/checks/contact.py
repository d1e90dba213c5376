"""C12 with contacts: rest, friction, collisions, pushing and blocking against theory.

Contacts of all three engines agree to millimetres at best; positions at rest to 1e-4 m, forces to 1e-3 of the weight.
"""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

import numpy as np

from guard_api import rotations
from guard_api.physics.backend import Backend
from guard_api.testing.checks.check import Finding, check, error, rounding
from guard_api.testing.checks.stepping import Values
from guard_api.testing.scenes import (
    RADIUS,
    TIMESTEP,
    WEIGHTLESS,
    ball,
    bodies_scene,
    body,
    cube,
    idle,
    loose_link,
    robot_scene,
    running,
)

G = 9.81

PENETRATION = 1e-4
"""Depth [m] at which a kilogram may rest in the floor under the `rigid` preset."""

REBOUND = 0.02
"""Share of the approach speed left after an impact with restitution 0: that of a contact critically damped over two
timesteps; hard contacts have none."""


def tilted(slope: float) -> tuple[float, float, float]:
    """Return gravity seen from a floor that falls along x by `slope` [rad]."""
    return (G * np.sin(slope), 0.0, -G * np.cos(slope))


@check("C12", contacts=True)
def resting_robot(backend: Backend) -> list[Finding]:
    """A robot on the floor feels its weight in `touch`, rests at its height and is still.

    The mean force over 0.1 s is the weight up to m dv / T of what it still moves; the rest is the solver's residual.
    """
    mass = 2.0
    findings = []
    for name, shape in (("ball", ball()), ("cube", cube())):
        scene = robot_scene(loose_link(mass=mass, collisions=(shape,)), gravity=(0, 0, -G), ground=True)
        with running(backend, scene, base_position=(0.0, 0.0, RADIUS + 0.001)) as world:
            world.step(idle(world), 250)
            world.step(idle(world), 50)
            state = world.state()
        findings += [
            error(f"touch of a {name}", state.touch[0, 0], mass * G, 2e-3 * mass * G, "N"),
            error(f"height of a {name}", state.link_position[0, 0, 2], RADIUS, PENETRATION, "m"),
            error(f"speed of a {name}", state.link_linear_velocity[0, 0], 0.0, 1e-3, "m/s"),
        ]
    return findings


@check("C12", contacts=True)
def resting_bodies(backend: Backend) -> list[Finding]:
    """Bodies dropped 5 cm settle on the floor and on each other at their heights, upright and still."""
    scene = bodies_scene(("boxes", body(), 2), ("balls", body(sphere=True), 1))
    place = [(0.0, 0.0, RADIUS + 0.05), (0.0, 0.0, 3 * RADIUS + 0.051), (1.0, 0.0, RADIUS + 0.05)]
    with running(backend, scene, body_position=place) as world:
        world.step(idle(world), 500)
        state = world.state()
    up = rotations.rotate(state.body_quaternion[0, :2], [0.0, 0.0, 1.0])
    return [
        error("heights", state.body_position[0, :, 2], [RADIUS, 3 * RADIUS, RADIUS], 2 * PENETRATION, "m"),
        # A corner of the cube may stand deeper than another by the penetration.
        error("uprightness of the boxes", up, [[0, 0, 1]] * 2, PENETRATION / RADIUS, "rad"),
        error("speeds", state.body_linear_velocity, 0.0, 1e-3, "m/s"),
    ]


@check("C12", contacts=True)
def incline_sticks(backend: Backend) -> list[Finding]:
    """On a slope of atan(mu) - 2 degrees, boxes stay: bodies and robots creep at no more than 2 mm/s on average.

    Friction of an iterated or regularised solver creeps; 1 mm/s is measured on the loosest engine at this slope.
    """
    way, _ = _slide(backend, np.arctan(0.5) - np.deg2rad(2.0))
    return [error(f"creep of a {name}", way[i, -1] / SLIDE, 0.0, 2e-3, "m/s") for i, name in enumerate(MOVERS)]


@check("C12", contacts=True)
def incline_slips(backend: Backend) -> list[Finding]:
    """On slopes of atan(mu) + 2 and + 10 degrees boxes slide at g (sin - mu cos): friction is mu within 2 %.

    Measured by the way from rest, a t^2 / 2, so that a box that hops along is not judged by one moment.
    """
    findings = []
    for beyond in (2.0, 10.0):
        slope = np.arctan(0.5) + np.deg2rad(beyond)
        way, _ = _slide(backend, slope)
        friction = np.tan(slope) - 2 * way[:, -1] / (SLIDE**2 * G * np.cos(slope))
        what = f"friction, {beyond:g} degrees beyond"
        findings += [error(f"{what}, {name}", friction[i], 0.5, 0.01) for i, name in enumerate(MOVERS)]
    return findings


@check("C12", contacts=True)
def sliding_stays_down(backend: Backend) -> list[Finding]:
    """Boxes that slide down a slope of atan(mu) + 10 degrees keep to the floor within 1 mm: they do not hop.

    Coulomb friction lifts nothing. A solver that relaxes it to a convex problem trades slip against separation.
    """
    _, height = _slide(backend, np.arctan(0.5) + np.deg2rad(10.0))
    return [error(f"height of a {name}", height[i], RADIUS, 1e-3, "m") for i, name in enumerate(MOVERS)]


SLIDE = 0.5
"""Time that boxes are given on a slope [s]."""

MOVERS = ("body", "robot")


def _slide(backend: Backend, slope: float) -> tuple[np.ndarray, np.ndarray]:
    """Return how far down the slope, and how high, a body and a robot of friction 0.5 are every 10 ms: (2, T) [m]."""
    robot = loose_link(mass=1.0, inertia=1.0 * (2 * RADIUS) ** 2 / 6, collisions=(cube(friction=0.5),))
    scene = bodies_scene(("box", body(friction=0.5), 1), robot=robot, gravity=tilted(slope))
    start: Values = {"base_position": (0.0, 0.0, RADIUS), "body_position": (0.0, 2.0, RADIUS)}
    places = []
    with running(backend, scene, 1, **start) as world:
        for _ in range(round(SLIDE / TIMESTEP / 5)):
            world.step(idle(world), 5)
            state = world.state()
            places.append([state.body_position[0, 0], state.link_position[0, 0]])
    track = np.array(places)
    return track[:, :, 0].T, track[:, :, 2].T


@check("C12", contacts=True)
def friction_of_a_pair(backend: Backend) -> list[Finding]:
    """Between two moving bodies the larger friction counts, against static ones the mover's own.

    A smooth box (0.1) on a rough slab (0.8) stays at 25 degrees, where 0.47 is needed; on a static slab it slides with
    its own 0.1.
    """
    slope = np.deg2rad(25.0)
    speeds = []
    for physics in ("dynamic", "static"):
        slab = body(physics, half=0.5, friction=0.8, mass=50.0 if physics == "dynamic" else 0.0)
        scene = bodies_scene(("slab", slab, 1), ("box", body(friction=0.1), 1), gravity=tilted(slope))
        with running(backend, scene, body_position=[(0, 0, 0.5), (-0.2, 0, 1.0 + RADIUS)]) as world:
            world.step(idle(world), 25)
            early = world.state()
            world.step(idle(world), 100)
            late = world.state()
        speeds.append(float((late.body_linear_velocity - early.body_linear_velocity)[0, 1, 0]))
    own = np.tan(slope) - speeds[1] / (0.2 * G * np.cos(slope))
    return [
        error("creep on a rough dynamic slab", speeds[0], 0.0, 5e-3, "m/s"),
        error("friction on a rough static slab", own, 0.1, 0.01),
    ]


@check("C12", contacts=True)
def collision_keeps_momentum(backend: Backend) -> list[Finding]:
    """Two balls that collide keep their momentum to rounding."""
    velocity = _collide(backend)
    momentum = velocity[0] + 3.0 * velocity[1]
    noise = rounding(backend, 3.0, 150, operations=16)
    return [
        error("momentum", momentum, [-0.5, 0.0, 0.0], noise, "kg m/s"),
        Finding(
            what="balls that pass through each other", value=float(velocity[0, 0] > 0.5), tolerance=0, unit="count"
        ),
    ]


@check("C12", contacts=True)
def collision_without_rebound(backend: Backend) -> list[Finding]:
    """Two balls with restitution 0 go on together: they part at less than 2 % of the speed they met at."""
    velocity = _collide(backend)
    return [error("speed apart", velocity[0, 0] - velocity[1, 0], 0.0, REBOUND * 1.5, "m/s")]


def _collide(backend: Backend) -> np.ndarray:
    """Return the velocities (2, 3) of a ball of 1 kg at 1 m/s and one of 3 kg at -0.5 m/s after they met."""
    scene = bodies_scene(
        ("light", body(sphere=True, mass=1.0), 1),
        ("heavy", body(sphere=True, mass=3.0), 1),
        gravity=WEIGHTLESS,
        ground=False,
    )
    start: Values = {"body_position": [(-0.15, 0, 0), (0.1, 0, 0)], "body_linear_velocity": [(1, 0, 0), (-0.5, 0, 0)]}
    with running(backend, scene, 1, **start) as world:
        world.step(idle(world), 150)
        return world.state().body_linear_velocity[0]


@check("C12", contacts=True)
def restitution_zero(backend: Backend) -> list[Finding]:
    """A ball with restitution 0 dropped from 5 cm stays down: its rebound is below 2 % of its speed."""
    fastest, rebound = _drop(backend, 0.0)
    return [
        error("speed of impact", fastest, (2 * G * 0.05) ** 0.5, 2 * G * TIMESTEP, "m/s"),
        Finding(what="speed of rebound", value=rebound, tolerance=REBOUND * fastest, unit="m/s"),
    ]


@check("C12", contacts=True)
def restitution_half(backend: Backend) -> list[Finding]:
    """A ball with restitution 0.5 leaves the floor with half its speed, to 10 % and what gravity does in two steps."""
    fastest, rebound = _drop(backend, 0.5)
    return [error("speed of rebound", rebound, 0.5 * fastest, 0.1 * 0.5 * fastest + 2 * G * TIMESTEP, "m/s")]


def _drop(backend: Backend, restitution: float) -> tuple[float, float]:
    """Return the fastest speed down, and the fastest up after it [m/s], of a ball let go 5 cm above the floor."""
    scene = bodies_scene(("ball", body(sphere=True, restitution=restitution), 1))
    speeds = np.empty(120)
    with running(backend, scene, body_position=(0.0, 0.0, RADIUS + 0.05)) as world:
        for i in range(len(speeds)):
            world.step(idle(world), 1)
            speeds[i] = world.state().body_linear_velocity[0, 0, 2]
    impact = int(np.argmin(speeds))
    return float(-speeds[impact]), float(max(0.0, speeds[impact:].max()))
