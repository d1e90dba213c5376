"""The robots that GUARD finds by name: those it ships, and those of plugins.

A robot is a folder `urdf/<robot>/` below a root, with `<robot>.urdf` and `robot.toml`. Besides the shipped root,
every entry point of the group `guard.robots` gives one: it loads to a function that returns the root's path.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from guard_api import plugins
from guard_api.errors import PluginError, unknown_name
from guard_api.model.reader import read_robot
from guard_api.model.robot import RobotModel

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_root() -> Path:
    """Return the folder of the shipped assets: inside the installed package, else beside it in a checkout.

    Raises PluginError when there is neither.
    """
    for folder in (_PACKAGE / "_assets", _PACKAGE.parent / "assets"):
        if (folder / "urdf").is_dir():
            return folder
    raise PluginError(f"no robots in {_PACKAGE / '_assets'}: the installation is incomplete, install guard-api again")


def robot_names() -> list[str]:
    """Return the sorted names of all robots, reading none of them."""
    return sorted(_folders())


def robot_files(name: str) -> list[Path]:
    """Return every file in the folder of robot `name`, sorted: what its model depends on."""
    return sorted(path for path in _folder(name).rglob("*") if path.is_file())


@cache
def load_robot(name: str) -> RobotModel:
    """Return the robot `name`; it is read once per process.

    Raises SpecError for an unknown name, with the nearest ones, and ModelError for files that cannot be used.
    """
    folder = _folder(name)
    return read_robot(folder / f"{name}.urdf", folder / "robot.toml", name=name)


def load_robot_file(urdf: Path, side_file: Path | None = None) -> RobotModel:
    """Return the robot of a user's own URDF; without `side_file`, the `robot.toml` beside it is used if there is one.

    Raises ModelError that lists every problem of both files.
    """
    return read_robot(urdf, side_file)


def _folder(name: str) -> Path:
    folders = _folders()
    if name not in folders:
        raise unknown_name("robot", name, folders)
    return folders[name]


def _folders() -> dict[str, Path]:
    """Return robot name -> its folder over all roots. Raises PluginError for a name that two roots claim."""
    roots = [shipped_root(), *(Path(plugins.load("guard.robots", name)()) for name in plugins.names("guard.robots"))]
    folders: dict[str, Path] = {}
    for root in dict.fromkeys(root.resolve() for root in roots):
        for folder in sorted((root / "urdf").glob("*")):
            if not (folder / f"{folder.name}.urdf").is_file():
                continue
            if folder.name in folders:
                raise PluginError(
                    f"two robots are called {folder.name!r}: {folders[folder.name]} and {folder}: rename one"
                )
            folders[folder.name] = folder
    return folders
