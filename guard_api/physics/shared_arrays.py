"""The arrays that a sharded world and its workers share: anonymous memory, laid out the same way on both sides."""

from __future__ import annotations

import mmap
import os
import tempfile
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.state import Start, State, state_dtype, state_shapes
from guard_api.scene.spec import SceneSpec

_ALIGNMENT = 64


class SharedArrays:
    """Control, reset mask, start, drive targets and state of all N worlds of `scene`, by name.

    The memory has no name in any file system, so nothing is left behind however its processes end.
    """

    def __init__(self, scene: SceneSpec, num_worlds: int, file: int) -> None:
        """Map the memory behind the descriptor `file`, which may be closed afterwards."""
        self._memory = mmap.mmap(file, _size(scene, num_worlds))
        self._arrays: dict[str, NDArray[Any]] = {}
        offset = 0
        for name, (shape, dtype) in _layout(scene, num_worlds).items():
            count = int(np.prod(shape))
            self._arrays[name] = np.frombuffer(self._memory, dtype, count, offset).reshape(shape)
            offset += _padded(shape, dtype)

    @staticmethod
    def allocate(scene: SceneSpec, num_worlds: int) -> int:
        """Return the descriptor of new zeroed memory of the right size; the caller closes it."""
        if hasattr(os, "memfd_create"):
            file = os.memfd_create("guard-worlds")
        else:
            with tempfile.TemporaryFile() as unnamed:
                file = os.dup(unnamed.fileno())
        os.ftruncate(file, _size(scene, num_worlds))
        return file

    def close(self) -> None:
        """Free the memory here; it is gone when the other side has done so too."""
        self._arrays.clear()
        self._memory.close()

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return an array: "control", "mask", "start.FIELD", "state.FIELD", "drive.GROUP.position" or ".quaternion"."""
        return self._arrays[name]

    def state(self) -> State:
        """Return a copy of the state."""
        return State(**{item.name: self[f"state.{item.name}"].copy() for item in fields(State)})

    def set_state(self, state: State, rows: slice) -> None:
        """Write the state of the worlds `rows`."""
        for item in fields(State):
            self[f"state.{item.name}"][rows] = getattr(state, item.name)

    def start(self, rows: slice) -> Start:
        """Return a copy of the start of the worlds `rows`."""
        return Start(**{item.name: self[f"start.{item.name}"][rows].copy() for item in fields(Start)})

    def set_start(self, start: Start) -> None:
        """Write the start of all worlds."""
        for item in fields(Start):
            self[f"start.{item.name}"][...] = getattr(start, item.name)


def _layout(scene: SceneSpec, num_worlds: int) -> dict[str, tuple[tuple[int, ...], type]]:
    robot = scene.robot
    shapes = state_shapes(scene, num_worlds)
    base = {"position": 3, "quaternion": 4, "linear_velocity": 3, "angular_velocity": 3}
    layout: dict[str, tuple[tuple[int, ...], type]] = {
        "control": ((num_worlds, len(robot.actuators) if robot else 0), np.float64),
        "mask": ((num_worlds,), np.bool_),
    }
    for item in fields(Start):
        kind, _, rest = item.name.partition("_")
        layout[f"start.{item.name}"] = ((num_worlds, base[rest]) if kind == "base" else shapes[item.name], np.float64)
    for name, shape in shapes.items():
        layout[f"state.{name}"] = (shape, state_dtype(name))
    for group in scene.groups:
        if group.body.physics == "driven":
            layout[f"drive.{group.name}.position"] = ((num_worlds, group.count, 3), np.float64)
            layout[f"drive.{group.name}.quaternion"] = ((num_worlds, group.count, 4), np.float64)
    return layout


def _padded(shape: tuple[int, ...], dtype: type) -> int:
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return -(-size // _ALIGNMENT) * _ALIGNMENT


def _size(scene: SceneSpec, num_worlds: int) -> int:
    return sum(_padded(shape, dtype) for shape, dtype in _layout(scene, num_worlds).values())
