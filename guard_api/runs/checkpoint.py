"""Checkpoints: tensors in safetensors, state in JSON, both checked by SHA-256. Loading one never runs code."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from guard_api.errors import RunError
from guard_api.runs.atomic import read_json, write_bytes, write_folder, write_json

TENSORS_FILE = "tensors.safetensors"
STATE_FILE = "state.json"
FORMAT = "guard-checkpoint-1"

NUMBERED = re.compile(r"\d{6,}")
"""Names of the folders of checkpoints that can be resumed: their epoch."""


def save_checkpoint(path: Path, tensors: Mapping[str, np.ndarray], state: Mapping[str, Any]) -> None:
    """Write the folder `path` with `tensors` and the JSON-serialisable `state`, whole or not at all.

    Raises RunError when the disk is full, TypeError when `state` is not JSON-serialisable.
    """
    data = save({name: np.ascontiguousarray(array) for name, array in tensors.items()})
    envelope = {
        "format": FORMAT,
        "tensors_sha256": hashlib.sha256(data).hexdigest(),
        "state_sha256": _state_digest(state),
        "state": dict(state),
    }

    def fill(folder: Path) -> None:
        write_bytes(folder / TENSORS_FILE, data)
        write_json(folder / STATE_FILE, envelope)

    write_folder(path, fill)


def load_checkpoint(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the tensors and the state of the checkpoint folder `path`.

    Raises RunError, naming the file and the remedy, when it is missing, truncated, altered or not a checkpoint.
    """
    path = Path(path)
    if not path.is_dir():
        raise RunError(f"{path}: no such checkpoint: name a folder under checkpoints/ of a run")
    remedy = _remedy(path)
    envelope = read_json(path / STATE_FILE, remedy)
    if envelope.get("format") != FORMAT:
        found = envelope.get("format")
        raise RunError(f"{path / STATE_FILE}: format {found!r} is not {FORMAT!r}: it is not a checkpoint of this GUARD")
    state = envelope.get("state")
    if not isinstance(state, dict) or envelope.get("state_sha256") != _state_digest(state):
        raise RunError(f"{path / STATE_FILE}: corrupt (its SHA-256 does not match): {remedy}")
    file = path / TENSORS_FILE
    try:
        data = file.read_bytes()
    except OSError as error:
        raise RunError(f"{file}: cannot be read ({error.strerror}): {remedy}") from error
    if hashlib.sha256(data).hexdigest() != envelope.get("tensors_sha256"):
        raise RunError(f"{file}: corrupt (its SHA-256 does not match {STATE_FILE}): {remedy}")
    try:
        return load(data), state
    except SafetensorError as error:
        raise RunError(f"{file}: not a safetensors file ({error}): {remedy}") from error


def _remedy(path: Path) -> str:
    """Return what to do where the checkpoint `path` is damaged: it depends on those beside it."""
    if not NUMBERED.fullmatch(path.name):
        return "use another checkpoint, or train again"
    others = [other for other in path.absolute().parent.iterdir() if NUMBERED.fullmatch(other.name)]
    earlier = [other.name for other in others if int(other.name) < int(path.name)]
    before = f"checkpoint {max(earlier, key=int)}" if earlier else "the start"
    return f"delete the folder {path} and train on with --resume, which then goes on from {before}"


def _state_digest(state: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(state, sort_keys=True).encode()).hexdigest()
