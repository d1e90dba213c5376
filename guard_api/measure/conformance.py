"""What the conformance suite finds of one robot on one simulator, as JSON data."""

from __future__ import annotations

from typing import Any

from guard_api import plugins
from guard_api.model.library import load_robot
from guard_api.testing.checks.own_robot import robot_checks
from guard_api.testing.conformance import check_robots


def checks_of(robot: str) -> list[str]:
    """Return the names of the checks that `robot` has: what was found of it by others is out of date."""
    return [item.name.partition(":")[0] for item in robot_checks(load_robot(robot))]


def measure_conformance(robot: str, backend: str) -> dict[str, Any]:
    """Return every check of `robot` on `backend`: name, status, reason and worst finding; and what it approximates."""
    report = check_robots(plugins.load("guard.backends", backend), [load_robot(robot)])
    checks = []
    for result in report.results:
        found = {"check": result.name.partition(":")[0], "status": result.status, "reason": result.reason}
        if worst := result.worst:
            found |= {"what": worst.what, "value": worst.value, "tolerance": worst.tolerance, "unit": worst.unit}
        checks.append(found)
    return {"checks": checks, "approximations": list(report.approximations[robot])}
