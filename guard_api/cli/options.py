"""Command lines from dataclasses: the option dataclass of a command *is* its command line."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar, cast

import tyro

from guard_api import plugins
from guard_api.errors import SpecError

T = TypeVar("T")


def parse(options: type[T], name: str, argv: Sequence[str], description: str) -> T:
    """Parse `argv` into the dataclass `options`; prints help or one clear error and exits when it cannot."""
    return tyro.cli(options, prog=f"guard {name}", args=list(argv), description=description)


def parse_with_algorithm(generic: Any, name: str, argv: Sequence[str], description: str) -> tuple[Any, Any]:
    """Parse `argv` into `generic[config type of the algorithm]`; return the options and the algorithm.

    Which options exist depends on --algo, so that flag is looked up first.
    """
    default = next(field.default for field in dataclasses.fields(generic) if field.name == "algo")
    algorithm = plugins.load("guard.algorithms", _flag(argv, "--algo", str(default)))
    options = parse(cast("type[Any]", generic[algorithm.config_type]), name, argv, description)
    return options, algorithm


def whole_steps(total_steps: float) -> int:
    """Return --total-steps, which may be written 1e6, as a whole number. Raises SpecError below 1 and for NaN."""
    if not 1 <= total_steps < float("inf"):
        raise SpecError(f"--total-steps is {total_steps}: it must be at least 1")
    return int(total_steps)


def _flag(argv: Sequence[str], flag: str, default: str) -> str:
    """Return the value of `flag` in `argv`, or `default`. Raises SpecError when its value is missing."""
    for i, word in enumerate(argv):
        if word == flag:
            if i + 1 == len(argv):
                raise SpecError(f"{flag} needs a value")
            return argv[i + 1]
        if word.startswith(flag + "="):
            return word.removeprefix(flag + "=")
    return default
