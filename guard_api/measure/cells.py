"""Results that grow cell by cell in one file: an interrupted measurement keeps every cell that it finished."""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from guard_api import plugins
from guard_api.errors import GuardError
from guard_api.runs.atomic import read_json, write_json
from guard_api.runs.manifest import asset_hashes, describe_machine, package_versions

REMEDY = "measure it again with: guard compare"


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One measurement of a table: `key` names its place in it, such as {"robot": "ant", "backend": "mujoco"}.

    backends: all that take part. settings: what else decides the numbers. measure: makes them, as JSON data.
    """

    key: Mapping[str, str]
    robot: str
    backends: tuple[str, ...]
    settings: Mapping[str, Any]
    measure: Callable[[], dict[str, Any]]


def run_cells(
    path: Path, cells: Sequence[Cell], *, again: bool = False, report: Callable[[Cell, int], None] = lambda *_: None
) -> list[dict[str, Any]]:
    """Measure the `cells` that `path` does not hold yet, writing after each; return the records of all of them.

    A record is a cell's key, what made it and its `values`, or the `error` of a simulator that refused. It counts as
    held while its settings, the robot's files, the engines' versions and the plugins' code are the same and it is no
    error. again: measure all of them anyway. report: called before each cell with its position.
    """
    held = read_records(path) if path.exists() else []
    records = []
    for position, cell in enumerate(cells):
        report(cell, position)
        identity = _identity(cell)
        record = None if again else next((r for r in held if _is(r, {**cell.key, **identity}) and "values" in r), None)
        if record is None:
            record = _measured(cell, identity)
            held = sorted([*(r for r in held if not _is(r, cell.key)), record], key=lambda r: _place(r, cell.key))
            write_json(path, {"cells": held})
        records.append(record)
    return records


def read_records(path: Path) -> list[dict[str, Any]]:
    """Return the records of a file of cells. Raises RunError for a file that is missing or none of ours."""
    return list(read_json(path, REMEDY).get("cells", []))


def _measured(cell: Cell, identity: Mapping[str, Any]) -> dict[str, Any]:
    begin = time.perf_counter()
    try:
        result = {"values": cell.measure()}
    except GuardError as error:  # one engine that refuses a robot must not cost the other cells
        result = {"error": str(error)}
    seconds = round(time.perf_counter() - begin, 1)
    versions = {**package_versions(), **identity["engines"]}
    machine = {**describe_machine(), "versions": versions, "seconds": seconds}
    return {**cell.key, **identity, **result, "manifest": machine}


def _identity(cell: Cell) -> dict[str, Any]:
    """Return what a held record must share with `cell`, as it reads in JSON."""
    plugged = {name: plugins.load("guard.backends", name) for name in cell.backends}
    engines: dict[str, str] = {}
    for backend in plugged.values():
        engines |= backend.versions()
    return {
        "settings": dict(cell.settings),
        "engines": engines,
        "code": {name: _code_hash(type(backend).__module__) for name, backend in plugged.items()},
        "assets": asset_hashes(cell.robot),
    }


def _code_hash(module: str) -> str:
    """Return a 16-digit hash of the Python files beside `module`: of a plugin's code."""
    file = sys.modules[module].__file__
    assert file is not None  # plugins are written in Python
    digest = hashlib.sha256()
    for source in sorted(Path(file).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _is(record: Mapping[str, Any], values: Mapping[str, Any]) -> bool:
    return all(record.get(name) == value for name, value in values.items())


def _place(record: Mapping[str, Any], key: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(str(record.get(name)) for name in key)
