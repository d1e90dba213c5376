"""Command lines from dataclasses: the option dataclass of a command *is* its command line."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

import tyro

from guard_api import plugins
from guard_api.algorithm import Algorithm, find_preset
from guard_api.errors import SpecError
from guard_api.typed import Reader

T = TypeVar("T")


def parse(options: type[T], name: str, argv: Sequence[str], description: str, default: T | None = None) -> T:
    """Parse `argv` into the dataclass `options`; prints help or one clear error and exits when it cannot.

    default: what takes the place of the dataclass's own defaults.
    """
    instead: dict[str, Any] = {} if default is None else {"default": default}
    return tyro.cli(options, prog=f"guard {name}", args=list(argv), description=description, **instead)


def parse_with_algorithm(
    generic: Any, name: str, argv: Sequence[str], description: str, recorded: Mapping[str, Any] | None = None
) -> tuple[Any, Any]:
    """Parse `argv` into `generic[config type of the algorithm]`; return the options and the algorithm.

    Which options exist depends on --algo, and what those that are not given are on --preset, where `generic` has that
    one: so both flags are looked up first. recorded: what they were in an earlier call, by name, which then counts
    instead of any defaults; `algorithm` holds those of the algorithm.
    """
    usual = recorded or {field.name: field.default for field in dataclasses.fields(generic)}
    algorithm = plugins.load("guard.algorithms", last_value(argv, "--algo", str(usual["algo"])))
    has_presets = "preset" in {field.name for field in dataclasses.fields(generic)}
    preset = last_value(argv, "--preset", "") if has_presets else ""
    kind = cast("type[Any]", generic[algorithm.config_type])
    default = None
    if recorded:
        same = algorithm.name == recorded["algo"]
        config = _config(algorithm, recorded["algorithm"]) if same else algorithm.config_type()
        default = _with_required(generic, {**recorded, "algorithm": config})
    elif preset:
        default = _preset_defaults(generic, algorithm, preset)
    return parse(kind, name, argv, description, default), algorithm


def _config(algorithm: Algorithm, data: Mapping[str, Any]) -> Any:
    """Return the algorithm's options from JSON data. Raises SpecError where they do not fit."""
    reader = Reader({})
    config = reader.read(algorithm.config_type, data)
    if config is None:
        raise SpecError(f"the options of the run do not fit {algorithm.name}: {'; '.join(reader.faults)}")
    return config


def last_value(argv: Sequence[str], flag: str, default: str) -> str:
    """Return the value of the last `flag` in `argv`, or `default`. Raises SpecError when its value is missing."""
    for i in reversed(range(len(argv))):
        if argv[i] == flag:
            if i + 1 == len(argv):
                raise SpecError(f"{flag} needs a value")
            return argv[i + 1]
        if argv[i].startswith(flag + "="):
            return argv[i].removeprefix(flag + "=")
    return default


def _preset_defaults(generic: Any, algorithm: Algorithm, name: str) -> Any:
    """Return `generic` with the preset's settings, and MISSING for what has no default."""
    preset = find_preset(algorithm, name)
    values = {
        "total_steps": float(preset.total_steps),
        "num_worlds": preset.num_worlds,
        "algorithm": algorithm.config_type(**preset.options),
    }
    return _with_required(generic, values)


def _with_required(generic: Any, values: Mapping[str, Any]) -> Any:
    """Return `generic` with `values`, and MISSING for what has no default."""
    required = [field.name for field in dataclasses.fields(generic) if field.default is dataclasses.MISSING]
    return generic(**{**dict.fromkeys(required, tyro.MISSING), **values})


def whole_steps(total_steps: float) -> int:
    """Return --total-steps, which may be written 1e6, as a whole number. Raises SpecError below 1 and for NaN."""
    if not 1 <= total_steps < float("inf"):
        raise SpecError(f"--total-steps is {total_steps}: it must be at least 1")
    return int(total_steps)
