"""Snapshots as bytes: the engine's own save of every world, contacts included, and the numbers kept beside it."""

from __future__ import annotations

import hashlib
import io
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.scene.spec import SceneSpec
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet, quiet

_ENGINE, _SIZES, _SCENE = "engine_states", "engine_sizes", "scene"


def fingerprint(scene: SceneSpec, num_worlds: int) -> str:
    """Return what two worlds must share for one to restore the other's snapshot."""
    return hashlib.sha256(f"guard_bullet 2 {num_worlds} {scene!r}".encode()).hexdigest()


def pack(identity: str, instances: list[Instance], arrays: Mapping[str, NDArray]) -> bytes:
    """Return the engine states of `instances` and `arrays` as bytes."""
    states = [_save(instance) for instance in instances]
    stream = io.BytesIO()
    members = dict(arrays) | {
        _ENGINE: np.frombuffer(b"".join(states), np.uint8),
        _SIZES: np.array([len(state) for state in states], np.int64),
        _SCENE: np.array(identity),
    }
    np.savez(stream, allow_pickle=False, **members)
    return stream.getvalue()


def unpack(blob: bytes, identity: str, arrays: Mapping[str, NDArray]) -> list[bytes]:
    """Fill `arrays` from `blob` and return the engine states, one per world.

    Raises BackendError when `blob` is damaged or of another scene, number of worlds or plugin; nothing is changed then.
    """
    try:
        with np.load(io.BytesIO(blob), allow_pickle=False) as file:
            members = {name: file[name] for name in file.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile) as problem:
        raise BackendError(f"bullet: the snapshot is damaged or none of this backend: {problem}") from problem
    if _SCENE not in members or str(members[_SCENE]) != identity:
        raise BackendError(
            "bullet: the snapshot is of another scene or number of worlds; restore it into an equal world"
        )
    for name, array in arrays.items():
        array[...] = members[name]
    ends = np.cumsum(members[_SIZES])
    return [part.tobytes() for part in np.split(members[_ENGINE], ends[:-1])]


def load(instance: Instance, state: bytes) -> None:
    """Put an engine state saved by `pack` into an equal engine instance. Raises BackendError when it refuses."""
    with tempfile.TemporaryDirectory(prefix="guard_bullet_") as folder:
        path = Path(folder) / "state.bullet"
        path.write_bytes(state)
        try:
            with quiet():
                pybullet.restoreState(fileName=str(path), physicsClientId=instance.client)
        except pybullet.error as problem:
            raise BackendError(f"bullet: the engine refuses the snapshot: {problem}") from problem


def _save(instance: Instance) -> bytes:
    with tempfile.TemporaryDirectory(prefix="guard_bullet_") as folder:
        path = Path(folder) / "state.bullet"
        pybullet.saveBullet(str(path), physicsClientId=instance.client)
        return path.read_bytes()
