"""The joint limits of any robot: where each joint is stopped, how, and what the rest of the robot feels of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guard_api.model.robot import RobotModel
from guard_api.physics.backend import Backend
from guard_api.scene.spec import BodyGroup
from guard_api.testing.checks.check import Finding, rounding, worst
from guard_api.testing.checks.contact import REBOUND
from guard_api.testing.checks.flight import changed, driven, inside, reflected_inertia, velocities
from guard_api.testing.ideal.world import IdealBackend
from guard_api.testing.scenes import body, robot_scene, running

Array = NDArray[np.float64]

TRAVEL = 0.01
"""Most of a joint's range that it travels in a timestep on its way to a stop."""

BEFORE = 2.5
"""Timesteps of travel between a joint and its stop at the beginning."""

COAST, PUSH = 25, 60
"""Timesteps for which a joint is left alone at its stop, and for which it is pushed into it."""

GIVE = 0.125
"""Share of (2 h)^2 acceleration by which a stop gives: an impedance of 90 %, critically damped over two timesteps, and
a quarter more for what else the robot does meanwhile."""

FAR = (0.0, 0.0, 1e3)
"""Where a body stands that is not touched [m]: with it the robot is one that things can touch, as in every task."""

REACTION = 0.05
"""Share of the fastest motion by which what an impact leaves may differ."""


@dataclass(frozen=True, slots=True)
class _Runs:
    """One world for every end of every joint's range: the joint's column, which end (+-1), its place and speed there.

    joint: (N,). side, limit, speed: (N,). start: (N, J) positions.
    """

    joint: NDArray[np.intp]
    side: Array
    limit: Array
    speed: Array
    start: Array

    def own(self, array: Array) -> Array:
        """Return of `array` (N, J) the joint that each world is about, positive towards its stop: (N,)."""
        return self.side * array[np.arange(len(self.joint)), self.joint]

    def alone(self, values: Array) -> Array:
        """Return (N, J): `values` (N,) towards the stop for the joint that each world is about, 0 for the others."""
        array = np.zeros_like(self.start)
        array[np.arange(len(self.joint)), self.joint] = self.side * values
        return array


@dataclass(frozen=True, slots=True)
class _Trace:
    """What became of every joint: how far `beyond` its stop it was (T, N), and how fast towards it (T, N), coasting.

    after: (N, D) velocities of all coordinates at the end of the coast. pushed: (N,) beyond the stop at the end.
    """

    beyond: Array
    speed: Array
    after: Array
    pushed: Array

    def fastest_away(self, noise: float) -> Array:
        """Return the fastest speed (N,) away from a stop that a joint has reached and left, 0 where it has not.

        noise: how far from its stop a joint still counts as there. One that comes back from beyond is no rebound yet.
        """
        reached = np.maximum.accumulate(self.beyond, axis=0) >= -noise
        return np.where(reached & (self.beyond < -noise), -self.speed, 0.0).max(axis=0).clip(0.0)


def stops_hold(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Run every joint of a weightless, otherwise free `robot` into both of its stops, then push it against them.

    A time-stepping engine sees a limit at the end of a step at the earliest: a joint may pass it by a timestep's
    travel. A stop that is critically damped over two timesteps throws it back at 2 % of its speed, and gives under a
    push; a hard one does neither. Where the inertia that a joint moves changes with the others, an engine may size its
    stop for the one at joint positions 0: it gives in proportion, and a half more rebound is granted for it.
    The rest of the robot feels the reaction, and a joint may leave its stop for its sake: the reference says how.
    """
    robot = changed(driven(robot), stiffness=0.0, friction_loss=0.0, effort_limit=np.inf)
    runs, h = _runs(robot), robot.timestep
    moved, at_zero = _inertia(robot, runs, runs.start), _inertia(robot, runs, np.zeros_like(runs.start))
    acceleration = runs.speed / (4 * h)
    effort = runs.alone(acceleration * moved)
    got, expected = (_run(engine, robot, runs, effort) for engine in (backend, IdealBackend()))
    give = GIVE * (2 * h) ** 2 * acceleration * np.maximum(1.0, moved / at_zero)
    noise = rounding(backend, max(1.0, np.abs(runs.limit).max()), operations=8)
    rebound = np.maximum(0.0, got.fastest_away(noise) - expected.fastest_away(noise))
    fastest = np.maximum(runs.speed, np.abs(expected.after).max(axis=1))
    apart = np.abs(got.after - expected.after).max(axis=1)
    findings = []
    for i, speed in enumerate(runs.speed):
        findings += [
            _finding("joints past their stops", got.beyond[:, i].max(), speed * h + noise, "rad, m"),
            _finding("rebound from the stops", rebound[i] / speed, 1.5 * REBOUND + noise / h, "of the speed"),
            _finding("motion after the impact", apart[i] / fastest[i], REACTION + noise / h, "relative"),
            _finding("joints pushed past or kept off their stops", abs(got.pushed[i]), give[i] + noise, "rad, m"),
        ]
    return worst(findings)


def _finding(what: str, value: float, tolerance: float, unit: str) -> Finding:
    return Finding(what=what, value=float(value), tolerance=float(tolerance), unit=unit)


def _run(backend: Backend, robot: RobotModel, runs: _Runs, effort: Array) -> _Trace:
    """Let the joints coast into their stops, then push them with `effort` (N, J)."""
    # An engine may leave out what only contacts need where nothing can touch a robot.
    far = BodyGroup(name="far", body=body("static"), count=1)
    scene = robot_scene(robot, timestep=robot.timestep, groups=(far,))
    beyond, speeds = np.empty((2, COAST, len(runs.joint)))
    start = {"joint_position": runs.start, "joint_velocity": runs.alone(runs.speed), "body_position": FAR}
    with running(backend, scene, len(runs.joint), **start) as world:
        for i in range(COAST):
            world.step(np.zeros_like(effort), 1)
            state = world.state()
            beyond[i] = runs.own(state.joint_position) - runs.side * runs.limit
            speeds[i] = runs.own(state.joint_velocity)
        after = velocities([world.state()], robot.floating)[0]
        world.step(effort, PUSH)
        pushed = runs.own(world.state().joint_position) - runs.side * runs.limit
    return _Trace(beyond, speeds, after, pushed)


def _runs(robot: RobotModel) -> _Runs:
    limited = [(i, joint.limits) for i, joint in enumerate(robot.joints) if joint.limits]
    joint = np.repeat([i for i, _ in limited], 2).astype(np.intp)
    limit = np.array([limits for _, limits in limited], float).ravel()
    side = np.tile([-1.0, 1.0], len(limited))
    width = np.repeat([upper - lower for _, (lower, upper) in limited], 2)
    speed = np.minimum(1.0, TRAVEL * width / robot.timestep)
    start = np.tile(inside(robot), (len(joint), 1))
    start[np.arange(len(joint)), joint] = limit - side * BEFORE * speed * robot.timestep
    return _Runs(joint, side, limit, speed, start)


def _inertia(robot: RobotModel, runs: _Runs, q: Array) -> Array:
    """Return the inertia (N,) that each world's joint moves at joint positions `q` (N, J), the other joints free."""
    return np.array([reflected_inertia(robot, row)[joint] for row, joint in zip(q, runs.joint, strict=True)])
