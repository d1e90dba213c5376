"""The robots that GUARD finds by name, those it ships and those of plugins, and by the path of their file.

A robot with a name is a folder below a root, with its robot file and `robot.toml`: `urdf/<robot>/<robot>.urdf` or
`mjcf/<robot>/<robot>.xml`. Besides the shipped root, every entry point of the group `guard.robots` gives one: it loads
to a function that returns the root's path. Any other robot is called by the path of its URDF or MJCF (.xml) file.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from guard_api import plugins
from guard_api.errors import PluginError, SpecError, unknown_name
from guard_api.model.reader import MJCF_SUFFIX, SIDE_FILE, read_robot
from guard_api.model.robot import RobotModel
from guard_api.shapes import Mesh

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


def is_robot_file(robot: str) -> bool:
    """Return whether `robot` is the path of a robot file rather than a name, which never looks so."""
    return "/" in robot or robot.endswith(tuple(SUFFIXES.values()))


def robot_files(robot: str) -> list[Path]:
    """Return the files that the model of a robot, called by name or path, depends on, sorted.

    They are all those in the folder of a robot with a name; of one called by its path, that file, its side file and the
    meshes of its collision shapes.
    """
    file = _robot_file(robot)
    if not is_robot_file(robot):
        return sorted(path for path in file.parent.rglob("*") if path.is_file())
    shapes = (collision.shape for link in load_robot(robot).links for collision in link.collisions)
    meshes = {Path(shape.source) for shape in shapes if isinstance(shape, Mesh)}
    return sorted({file, *meshes, *(path for path in [side_file(robot)] if path.is_file())})


def side_file(robot: str) -> Path:
    """Return the side file of a robot called by name or path; one called by its path need not have it."""
    return _robot_file(robot).parent / SIDE_FILE


@cache
def load_robot(robot: str) -> RobotModel:
    """Return the robot called by name or by the path of its file; it is read once per process.

    Raises SpecError for an unknown name, with the nearest ones, and for a path where no file is; ModelError for files
    that cannot be used.
    """
    if is_robot_file(robot):
        return load_robot_file(_robot_file(robot))
    return read_robot(_robot_file(robot), side_file(robot), name=robot)


def load_robot_file(file: Path, side_file: Path | None = None) -> RobotModel:
    """Return the robot of a user's own URDF or MJCF (.xml).

    Without `side_file`, the `robot.toml` beside it is used if there is one. Raises ModelError that lists
    every problem of both files.
    """
    return read_robot(file, side_file)


def _robot_file(robot: str) -> Path:
    if is_robot_file(robot):
        file = Path(robot).resolve()
        if not file.is_file():
            raise SpecError(f"robot {robot!r}: there is no such file; robots with a name: `guard list robots`")
        return file
    files = _robot_files()
    if robot not in files:
        raise unknown_name("robot", robot, files)
    return files[robot]


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
