"""C4: what controls and gravity make of a robot's velocities within one substep, against the reference recursion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api.model.dynamics import Dynamics
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_api.physics.backend import Backend
from guard_api.physics.state import State
from guard_api.testing.checks.check import Finding, check, error, rounding
from guard_api.testing.checks.mechanics import BASES, GRAVITY, inertial_tolerance, laden_tree, placed, reference
from guard_api.testing.scenes import TIMESTEP, idle

Array = NDArray[np.float64]

SHORT: Final = TIMESTEP / 16
"""Substep [s] for a floating base, whose acceleration is compared to first order in it."""


@check("C4")
def acceleration(backend: Backend) -> list[Finding]:
    """One substep changes joint velocities by h (M + h D)^-1 (effort - D qd - K (q - rest) - bias) of the recursion."""
    return [joint_acceleration(backend, laden_tree(base)) for base in BASES]


def joint_acceleration(backend: Backend, robot: RobotModel, rounds: int = 1) -> Finding:
    """Compare the change of the joint velocities of `robot` over one substep with the reference recursion's."""
    got, joints, largest = [], [], 0.0
    for before, after, expected, _ in _steps(backend, robot, rounds, TIMESTEP):
        got.append((after.joint_velocity - before.joint_velocity) / TIMESTEP)
        joints.append(expected[:, expected.shape[1] - len(robot.joints) :])
        largest = max(largest, float(np.abs(expected).max()))
    tolerance = inertial_tolerance(backend, largest) + rounding(backend, 2.0, operations=8) / TIMESTEP
    return error(f"joints ({robot.base} base)", got, joints, tolerance, "rad/s^2, m/s^2")


@check("C4")
def base_acceleration(backend: Backend) -> list[Finding]:
    """One substep changes the velocity of a floating base by that of the reference recursion, to first order in h.

    An engine may integrate the velocity of the origin, that of the com or the momentum. They differ by no more than the
    acceleration changes during the substep, which the reference says too.
    """
    return free_acceleration(backend, laden_tree("floating"))


def free_acceleration(backend: Backend, robot: RobotModel, rounds: int = 1) -> list[Finding]:
    """Compare the change of the velocity of the floating base of `robot` over one substep with the recursion's."""
    got, base, tolerance = [], [], 0.0
    for before, after, expected, change in _steps(backend, robot, rounds, SHORT):
        push = after.link_linear_velocity - before.link_linear_velocity
        turn = after.link_angular_velocity - before.link_angular_velocity
        got.append(np.hstack([push[:, 0], turn[:, 0]]) / SHORT)
        base.append(expected[:, :6])
        noise = rounding(backend, 2.0, operations=8) / SHORT
        tolerance = max(tolerance, inertial_tolerance(backend, expected) + noise + change)
    return [
        error(f"base, {part}", np.stack(got)[..., rows], np.stack(base)[..., rows], tolerance, unit)
        for part, rows, unit in (("linear", slice(3), "m/s^2"), ("angular", slice(3, 6), "rad/s^2"))
    ]


def _steps(
    backend: Backend, robot: RobotModel, rounds: int, timestep: float
) -> Iterator[tuple[State, State, Array, float]]:
    """Yield the states around one substep, the reference acceleration (N, D), and how much its base part changes."""
    rng = np.random.default_rng(5)
    for world, _ in placed(backend, robot, rounds, gravity=GRAVITY, timestep=timestep):
        control = rng.uniform(-3.0, 3.0, idle(world).shape)
        before = world.state()
        world.step(control, 1)
        after = world.state()
        expected, later = (_reference_acceleration(robot, state, control, timestep) for state in (before, after))
        yield before, after, expected, float(np.abs(later - expected)[:, :6].max())


def _reference_acceleration(robot: RobotModel, state: State, control: Array, timestep: float) -> Array:
    poses, linear, angular = reference(robot, state)
    law = ActuationLaw(robot)
    geared = law.geared(control)
    q, qd = state.joint_position, state.joint_velocity
    effort = law.joint_effort(geared, q, qd) + law.spring_effort(q)
    return Dynamics(robot, GRAVITY).acceleration(
        poses, linear[:, 0], angular[:, 0], qd, effort=effort, timestep=timestep,
        thrust=law.thrust(geared, state.link_position[:, law.thrust_link, 2]),
    )  # fmt: skip
