"""Snapshots: the raw numbers behind a header that says whose they are."""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError

_MAGIC = b"guard-mujoco-1\n"


def fingerprint(model: mujoco.MjModel, num_worlds: int) -> bytes:
    """Return what identifies worlds that can share snapshots: the compiled model, engine included, and their number."""
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    digest = hashlib.sha256(buffer.tobytes())
    digest.update(f"{mujoco.mj_versionString()} {num_worlds}".encode())
    return digest.digest()


def pack(identity: bytes, arrays: Sequence[NDArray]) -> bytes:
    """Return `arrays` as bytes that `unpack` of the same `identity` understands."""
    return b"".join([_MAGIC, identity, *(array.tobytes() for array in arrays)])


def unpack(blob: bytes, identity: bytes, arrays: Sequence[NDArray]) -> None:
    """Write the numbers of `blob` into `arrays`, or raise BackendError and leave them alone."""
    header = len(_MAGIC) + len(identity)
    if not blob.startswith(_MAGIC):
        raise BackendError("restore: these bytes are no snapshot of a MuJoCo world")
    if blob[len(_MAGIC) : header] != identity:
        raise BackendError("restore: the snapshot is of another scene, number of worlds or MuJoCo version")
    if len(blob) != header + sum(array.nbytes for array in arrays):
        raise BackendError("restore: the snapshot is incomplete")
    offset = header
    for array in arrays:
        array[...] = np.frombuffer(blob, array.dtype, array.size, offset).reshape(array.shape)
        offset += array.nbytes
