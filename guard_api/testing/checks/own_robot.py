"""C3 and C4 for any robot: a user's own is built by an engine as exactly as the suite's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from guard_api.model.robot import RobotModel
from guard_api.physics.backend import Backend
from guard_api.testing.checks.check import Check, Finding
from guard_api.testing.checks.mechanics import (
    held_bias_force,
    held_inertials,
    held_mass_matrix,
    joint_acceleration,
    reset_links,
)

ROUNDS: Final = 25
"""Rounds of `WORLDS` random configurations: a hundred for each robot."""


def robot_checks(robot: RobotModel) -> tuple[Check, ...]:
    """Return the checks of the mechanics of `robot`, without what touches or rubs; named `check:robot`."""
    joints = tuple(replace(joint, friction_loss=0.0) for joint in robot.joints)
    bare = replace(robot, links=tuple(replace(link, collisions=()) for link in robot.links), joints=joints)
    floating = "floating_" if robot.floating else ""
    measures: list[tuple[str, str, Callable[[Backend, RobotModel], list[Finding]]]] = [
        ("C3", "links_after_reset", lambda backend, model: reset_links(backend, model, ROUNDS)),
        ("C4", "link_inertials", held_inertials),
        ("C4", f"{floating}mass_matrix", lambda backend, model: [held_mass_matrix(backend, model, ROUNDS)]),
        ("C4", f"{floating}bias_force", lambda backend, model: [held_bias_force(backend, model, ROUNDS)]),
        ("C4", "acceleration", lambda backend, model: [joint_acceleration(backend, model, ROUNDS)]),
    ]
    return tuple(_check(clause, f"{name}:{robot.name}", measure, bare) for clause, name, measure in measures)


def _check(clause: str, name: str, compare: Callable[[Backend, RobotModel], list[Finding]], robot: RobotModel) -> Check:
    def measure(backend: Backend) -> list[Finding]:
        return compare(backend, robot)

    what, of = name.split(":", 1)
    measure.__doc__ = f"{what.replace('_', ' ').capitalize()} of {of} as the model has it."
    return Check(clause=clause, name=name, measure=measure)
