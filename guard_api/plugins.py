"""Backends, algorithms, robots and terms as plugins: listing names imports nothing, loading imports that one."""

from __future__ import annotations

import sys
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, TypeAlias

from guard_api.conventions import BACKEND_API
from guard_api.errors import PluginError, unknown_name

Group: TypeAlias = Literal["guard.backends", "guard.algorithms", "guard.robots", "guard.tasks", "guard.constraints"]

_EXTRA_OF = {"mujoco": "mujoco", "pybullet": "bullet", "sapien": "sapien", "torch": "algos"}
"""Third-party module -> the extra of `guard-api` that installs it; used in hints only."""


def names(group: Group) -> list[str]:
    """Return the sorted names of the installed plugins of `group`, importing none of them."""
    return sorted({entry.name for entry in _installed(group, tuple(sys.path))})


def load(group: Group, name: str) -> Any:
    """Import and return the plugin `name` of `group`.

    Raises SpecError for an unknown name (with the nearest ones) and PluginError when its package is not
    installed (with the extra that installs it) or it was written for another backend API.
    """
    plugin = _import(_find(group, name))
    api = getattr(plugin, "api_version", BACKEND_API)
    if group == "guard.backends" and api != BACKEND_API:
        raise PluginError(
            f"backend {name!r} was written for backend API {api}, this GUARD has {BACKEND_API}: update it"
        )
    return plugin


def available(group: Group) -> dict[str, str | None]:
    """Return name -> None for every plugin that imports, name -> one-line reason for every one that does not."""
    result: dict[str, str | None] = {}
    for name in names(group):
        try:
            load(group, name)
        except PluginError as error:
            result[name] = str(error)
        else:
            result[name] = None
    return result


@cache
def _installed(group: Group, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of `group`; a search reads the metadata of every package, so it is done once per path."""
    return tuple(entry_points(group=group))


def _find(group: Group, name: str) -> EntryPoint:
    for entry in _installed(group, tuple(sys.path)):
        if entry.name == name:
            return entry
    raise unknown_name(group.removeprefix("guard.").removesuffix("s"), name, names(group))


def _import(entry: EntryPoint) -> Any:
    try:
        return entry.load()
    except ImportError as error:
        missing = (error.name or "").split(".")[0]
        if missing in _EXTRA_OF:
            raise PluginError(
                f"{entry.name!r} needs the package {missing!r}: pip install 'guard-api[{_EXTRA_OF[missing]}]'"
            ) from error
        raise PluginError(f"{entry.name!r} ({entry.value}) cannot be imported: {error}") from error
    except OSError as error:
        raise PluginError(f"{entry.name!r} ({entry.value}): a library it needs cannot be loaded: {error}") from error
    except AttributeError as error:
        raise PluginError(f"{entry.name!r} names {entry.value}, which does not exist: {error}") from error
