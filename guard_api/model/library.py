"""The robots that GUARD finds by name: those it ships, and those of plugins.

A robot is a folder below a root, with its robot file and `robot.toml`: `urdf/<robot>/<robot>.urdf` or
`mjcf/<robot>/<robot>.xml`. Besides the shipped root,
every entry point of the group `guard.robots` gives one: it loads to a function that returns the root's path.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from guard_api import plugins
from guard_api.errors import PluginError, SpecError, unknown_name
from guard_api.model.reader import MJCF_SUFFIX, SIDE_FILE, read_robot
from guard_api.model.robot import RobotModel

_PACKAGE = Path(__file__).resolve().parents[1]

SUFFIXES = {"urdf": ".urdf", "mjcf": MJCF_SUFFIX}
"""Folders below a root, and how the robot files in them end."""


def shipped_root() -> Path:
    """Return the folder of the shipped assets: inside the installed package, else beside it in a checkout.

    Raises PluginError when there is neither.
    """
    for folder in (_PACKAGE / "_assets", _PACKAGE.parent / "assets"):
        if any((folder / kind).is_dir() for kind in SUFFIXES):
            return folder
    raise PluginError(f"no robots in {_PACKAGE / '_assets'}: the installation is incomplete, install guard-api again")


def robot_names() -> list[str]:
    """Return the sorted names of all robots, reading none of them."""
    return sorted(_robot_files())


def robot_files(name: str) -> list[Path]:
    """Return every file in the folder of robot `name`, sorted: what its model depends on."""
    return sorted(path for path in _robot_file(name).parent.rglob("*") if path.is_file())


def side_file(name: str) -> Path:
    """Return the side file of robot `name`."""
    return _robot_file(name).parent / SIDE_FILE


@cache
def load_robot(name: str) -> RobotModel:
    """Return the robot `name`; it is read once per process.

    Raises SpecError for a file or an unknown name, with the nearest ones, and ModelError for files that cannot be used.
    """
    return read_robot(_robot_file(name), side_file(name), name=name)


def load_robot_file(file: Path, side_file: Path | None = None) -> RobotModel:
    """Return the robot of a user's own URDF or MJCF (.xml).

    Without `side_file`, the `robot.toml` beside it is used if there is one. Raises ModelError that lists
    every problem of both files.
    """
    return read_robot(file, side_file)


def _robot_file(name: str) -> Path:
    files = _robot_files()
    if name not in files:
        if "/" in name or name.endswith(tuple(SUFFIXES.values())):
            raise SpecError(
                f"robot {name!r} is a file: name a robot (`guard list robots`); an entry point of the group "
                "guard.robots gives your own a name, as in GUARD's examples/own_robot"
            )
        raise unknown_name("robot", name, files)
    return files[name]


def _robot_files() -> dict[str, Path]:
    """Return robot name -> its URDF or MJCF over all roots.

    Raises PluginError for a name that two of them claim, and for a robot whose file is not called like its folder.
    """
    roots = [shipped_root(), *(Path(plugins.load("guard.robots", name)()) for name in plugins.names("guard.robots"))]
    files: dict[str, Path] = {}
    for root in dict.fromkeys(root.resolve() for root in roots):
        for kind, suffix in SUFFIXES.items():
            for folder in sorted((root / kind).glob("*")):
                file = folder / f"{folder.name}{suffix}"
                if not file.is_file():
                    _check_no_robot(folder, file)
                    continue
                if folder.name in files:
                    raise PluginError(
                        f"two robots are called {folder.name!r}: {files[folder.name]} and {file}: rename one"
                    )
                files[folder.name] = file
    return files


def _check_no_robot(folder: Path, expected: Path) -> None:
    """Refuse a folder that holds a robot's files, but not the `expected` one; meshes, say, may stand beside robots."""
    names = sorted(path.name for path in folder.glob("*"))
    found = [name for name in names if name == SIDE_FILE or name.endswith(tuple(SUFFIXES.values()))]
    if found:
        place = f"{folder.parent.name}/<robot>/<robot>{expected.suffix}"
        raise PluginError(f"no {expected.name} in {folder}, but {', '.join(found)}: a robot's file is {place}")
