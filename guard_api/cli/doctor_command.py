"""`guard doctor`: what works on this machine, and what to do where something does not."""

from __future__ import annotations

import platform
import shutil
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from guard_api import __version__, plugins
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.env import make_environment
from guard_api.errors import GuardError, ModelError
from guard_api.model.library import load_robot, robot_names
from guard_api.physics.build import usable_cores

PROBE: Final = "Goal_Point_8Hazards"
"""The environment that is stepped once on every backend."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How to print."""

    json: bool = False
    """Print JSON instead of a table."""


def main(argv: Sequence[str]) -> int:
    """Run the command; exit code 1 when something that is installed does not work."""
    options = parse(Options, "doctor", argv, "Say what works on this machine.")
    rows = [*_machine(), *_backends(), *_algorithms(), *_robots()]
    if options.json:
        print_json(rows)
    else:
        print_table(f"GUARD {__version__}", ("what", "state", "note"), (row.values() for row in rows))
    return int(any(row["state"] == "broken" for row in rows))


def _row(what: str, state: str, note: str) -> dict[str, Any]:
    return {"what": what, "state": state, "note": note}


def _machine() -> list[dict[str, Any]]:
    free = shutil.disk_usage(".").free / 1e9
    return [
        _row("python", "ok", f"{platform.python_version()} at {sys.executable}"),
        _row("machine", "ok", f"{platform.system()} {platform.machine()}, {usable_cores()} usable cores"),
        _row("disk", "ok" if free > 1 else "low", f"{free:.0f} GB free here"),
    ]


def _backends() -> list[dict[str, Any]]:
    """Step one world of the suite's first environment on every backend: the shortest proof that it works."""
    rows = []
    for name, reason in plugins.available("guard.backends").items():
        if reason is not None:
            rows.append(_row(f"backend {name}", "missing", reason))
            continue
        try:
            versions = plugins.load("guard.backends", name).versions()
            with closing(make_environment(PROBE, backend=name, workers=1)) as env:
                env.step(np.zeros((1, env.action_size)))
        except Exception as error:  # noqa: BLE001 - a broken engine may raise anything, and saying so is the point
            rows.append(_row(f"backend {name}", "broken", f"{type(error).__name__}: {error}"))
        else:
            note = ", ".join(f"{package} {version}" for package, version in versions.items())
            rows.append(_row(f"backend {name}", "ok", note))
    return rows


def _algorithms() -> list[dict[str, Any]]:
    return [
        _row(f"algorithm {name}", "ok" if reason is None else "missing", reason or "")
        for name, reason in plugins.available("guard.algorithms").items()
    ]


def _robots() -> list[dict[str, Any]]:
    """Read every robot; a row for each that cannot be used, with its first problem, and one for all others."""
    try:
        names = robot_names()
    except GuardError as error:
        return [_row("robots", "broken", str(error))]
    rows = []
    for name in names:
        try:
            load_robot(name)
        except ModelError as error:
            rows.append(_row(f"robot {name}", "broken", str(error).splitlines()[0]))
    return [_row("robots", "ok", f"{len(names) - len(rows)} can be read"), *rows]
