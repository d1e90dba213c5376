"""`guard doctor`: what works on this machine, and what to do where something does not."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from guard_api import __version__, plugins
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.env import make_environment
from guard_api.errors import GuardError
from guard_api.suite import known_names


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How to print."""

    json: bool = False
    """Print JSON instead of a table."""


def main(argv: Sequence[str]) -> int:
    """Run the command; exit code 1 when something that is installed does not work."""
    options = parse(Options, "doctor", argv, "Say what works on this machine.")
    rows = [*_machine(), *_backends(), *_algorithms()]
    if options.json:
        print_json(rows)
    else:
        print_table(f"GUARD {__version__}", ("what", "state", "note"), (row.values() for row in rows))
    return int(any(row["state"] == "broken" for row in rows))


def _row(what: str, state: str, note: str) -> dict[str, Any]:
    return {"what": what, "state": state, "note": note}


def _machine() -> list[dict[str, Any]]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    free = shutil.disk_usage(".").free / 1e9
    return [
        _row("python", "ok", f"{platform.python_version()} at {sys.executable}"),
        _row("machine", "ok", f"{platform.system()} {platform.machine()}, {cores} usable cores"),
        _row("disk", "ok" if free > 1 else "low", f"{free:.0f} GB free here"),
    ]


def _backends() -> list[dict[str, Any]]:
    """Step one world of the suite's first environment on every backend: the shortest proof that it works."""
    rows = []
    for name, reason in plugins.available("guard.backends").items():
        if reason is not None:
            rows.append(_row(f"backend {name}", "missing", reason))
            continue
        versions = plugins.load("guard.backends", name).versions()
        note = ", ".join(f"{package} {version}" for package, version in versions.items())
        try:
            env = make_environment(known_names()[0], backend=name, workers=1)
            env.step(env.world.state().time[:, None].repeat(env.action_size, axis=1))
            env.close()
        except GuardError as error:
            rows.append(_row(f"backend {name}", "broken", f"{error}"))
        else:
            rows.append(_row(f"backend {name}", "ok", note))
    return rows


def _algorithms() -> list[dict[str, Any]]:
    return [
        _row(f"algorithm {name}", "ok" if reason is None else "missing", reason or "")
        for name, reason in plugins.available("guard.algorithms").items()
    ]
