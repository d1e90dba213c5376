"""C3, C4, C6 and C12 for any robot: a user's own is built, driven and stopped as the suite's are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, TypeAlias

from guard_api.model.robot import RobotModel
from guard_api.physics.backend import Backend
from guard_api.testing.checks.acceleration import free_acceleration, joint_acceleration
from guard_api.testing.checks.check import Check, Finding
from guard_api.testing.checks.flight import actuator_response, energy_drift, falls_freely, joint_inertia, thrust_climb
from guard_api.testing.checks.mechanics import (
    held_bias_force,
    held_inertials,
    held_mass_matrix,
    reset_links,
)
from guard_api.testing.checks.rest import lies_on_floor, rests_on_floor
from guard_api.testing.checks.stops import stops_hold

ROUNDS: Final = 25
"""Rounds of `WORLDS` random configurations: a hundred for each robot."""

OF_ROBOTS: Final = ("actuator_response", "thrust_climb", "joint_inertia", "energy_drift", "falls_freely", "stops_hold",
                    "rests_on_floor")  # fmt: skip
"""Names of checks that only robots have, beside those of the suite's own robots."""

Compare: TypeAlias = Callable[[Backend, RobotModel], list[Finding]]


def robot_checks(robot: RobotModel) -> tuple[Check, ...]:
    """Return the checks that say something of `robot`, named `check:robot`.

    All but the last are of the robot in the air, where nothing touches and no joint rubs.
    """
    smooth = replace(robot, joints=tuple(replace(joint, friction_loss=0.0) for joint in robot.joints))
    bare = replace(smooth, links=tuple(replace(link, collisions=()) for link in smooth.links))
    checks = [_check(clause, name, compare, bare) for clause, name, compare in _mechanics(robot) + _motion(robot)]
    if any(joint.limits for joint in robot.joints):
        checks.append(_check("C12", "stops_hold", stops_hold, _barely_touching(smooth)))
    if lies_on_floor(robot):
        checks.append(replace(_check("C12", "rests_on_floor", rests_on_floor, robot), contacts=True))
    return tuple(checks)


def _mechanics(robot: RobotModel) -> list[tuple[str, str, Compare]]:
    floating = "floating_" if robot.floating else ""
    checks: list[tuple[str, str, Compare]] = [
        ("C3", "links_after_reset", lambda backend, model: reset_links(backend, model, ROUNDS)),
        ("C4", "link_inertials", held_inertials),
        ("C4", f"{floating}mass_matrix", lambda backend, model: [held_mass_matrix(backend, model, ROUNDS)]),
        ("C4", f"{floating}bias_force", lambda backend, model: [held_bias_force(backend, model, ROUNDS)]),
        ("C4", "acceleration", lambda backend, model: [joint_acceleration(backend, model, ROUNDS)]),
    ]
    if robot.floating:
        checks.append(("C4", "base_acceleration", lambda backend, model: free_acceleration(backend, model, ROUNDS)))
    return checks


def _motion(robot: RobotModel) -> list[tuple[str, str, Compare]]:
    """Return the checks of motion in the air that `robot` has something for."""
    thrusts = any(actuator.law == "thrust" for actuator in robot.actuators)
    offered: list[tuple[bool, str, str, Compare]] = [
        (bool(robot.actuators), "C6", "actuator_response", actuator_response),
        (thrusts, "C6", "thrust_climb", thrust_climb),
        (any(joint.armature for joint in robot.joints), "C6", "joint_inertia", joint_inertia),
        (bool(robot.joints), "C12", "energy_drift", energy_drift),
        (robot.floating, "C12", "falls_freely", falls_freely),
    ]
    return [(clause, name, compare) for wanted, clause, name, compare in offered if wanted]


def _barely_touching(robot: RobotModel) -> RobotModel:
    """Return `robot` with the shapes of a single link, which cannot touch the others."""
    first = next((link.name for link in robot.links if link.collisions), None)
    links = [link if link.name == first else replace(link, collisions=()) for link in robot.links]
    return replace(robot, links=tuple(links))


def _check(clause: str, name: str, compare: Compare, robot: RobotModel) -> Check:
    def measure(backend: Backend) -> list[Finding]:
        return compare(backend, robot)

    measure.__doc__ = f"{name.replace('_', ' ').capitalize()}: {robot.name} is as the model has it."
    return Check(clause=clause, name=f"{name}:{robot.name}", measure=measure)
