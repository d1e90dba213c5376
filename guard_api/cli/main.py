"""The entry point of the `guard` command: finds the sub-command, runs it, and turns errors into one line."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from typing import Final

from guard_api import __version__
from guard_api.errors import GuardError, unknown_name

COMMANDS: Final[dict[str, str]] = {
    "list": "show environments, robots, tasks, constraints, algorithms or backends",
    "train": "train a policy on one backend",
    "suite": "train a grid of environments, algorithms, backends and seeds, some at a time",
    "plot": "draw learning curves of training runs, with intervals over seeds",
    "eval": "evaluate a trained policy on any backend",
    "export": "write a trained policy as an ONNX file",
    "transfer": "train on some backends, evaluate on all: the transfer matrix",
    "env": "show what environments consist of, observe and cost, and a picture of them",
    "robot": "show a robot as tables and a picture, or check its files and what the simulators make of them",
    "conform": "check a backend against the contract, clause by clause",
    "compare": "measure whether each robot is the same in every simulator: motion, gait, endurance, speed",
    "bench": "measure steps per second and the overhead over raw physics",
    "report": "tabulate training runs beside published results, or write a transfer's report again",
    "doctor": "say what works on this machine, and what to install where it does not",
}
"""Sub-command -> what it does; the module of the same name under `guard_api.cli` runs it."""


def main(argv: Sequence[str] | None = None) -> None:
    """Run `guard` and exit: 0 on success, 1 when a check failed, 2 on an error, 130 when interrupted."""
    sys.exit(run(list(sys.argv[1:] if argv is None else argv)))


def run(argv: list[str]) -> int:
    """Run one command line and return its exit code."""
    if not argv or argv[0] in {"-h", "--help", "--version"}:
        print(f"guard {__version__}" if "--version" in argv else _usage())
        return 0
    name, *rest = argv
    try:
        if name not in COMMANDS:
            raise unknown_name("command", name, COMMANDS)
        return importlib.import_module(f"guard_api.cli.{name}_command").main(rest)
    except GuardError as error:
        print(f"guard {name}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"guard {name}: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader of our output (head, less) left: nothing is wrong, but Python would complain while closing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _usage() -> str:
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()]
    return "\n".join(
        [
            "usage: guard COMMAND [options]",
            "",
            "One robot, one task, three simulators: return and constraint cost, measured across physics engines.",
            "",
            *lines,
            "",
            "guard COMMAND --help shows a command's options; --json prints machine-readable output.",
        ]
    )
