"""Environments without a name: a TOML file with the keys of `EnvSpec.to_json`, see `examples/environment.toml`."""

from __future__ import annotations

import tomllib
from pathlib import Path

from guard_api.errors import SpecError
from guard_api.model.library import is_robot_file
from guard_api.spec import EnvSpec

SUFFIX = ".toml"


def is_spec_file(env: str) -> bool:
    """Return whether `env` is the path of a specification rather than a name, which never ends so."""
    return env.endswith(SUFFIX)


def read_spec(path: Path) -> EnvSpec:
    """Return the environment that the file at `path` specifies; its name defaults to the file's.

    A robot called by its path, see `guard_api.model.library`, is looked for beside the file.

    Raises SpecError with every problem, one per line, that names the file and the key.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SpecError(f"{path}: cannot be read: {error}") from error
    robot = data.get("robot")
    if isinstance(robot, str) and is_robot_file(robot):
        data["robot"] = str((path.parent / robot).resolve())
    return EnvSpec.from_json({"name": path.stem, "constraints": [], **data}, source=str(path))
