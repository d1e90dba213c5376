"""A run directory: what was run, how it went and what came out.

These are `manifest.json` and `config.json`; `progress.csv` and TensorBoard events; `checkpoints/`.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from guard_api.errors import RunError
from guard_api.runs.atomic import disk_errors, read_json, write_json
from guard_api.runs.checkpoint import NUMBERED, save_checkpoint
from guard_api.runs.progress import KEYS, ProgressLog
from guard_api.runs.tensorboard import EventLog

FORMAT = "guard-run-1"
KEPT_CHECKPOINTS = 3
"""How many of the newest checkpoints a run keeps; older ones are deleted once a newer one is safe on the disk."""

BEST = "best"
"""Folder of the best policy's checkpoint."""


class RunDirectory:
    """One training run on disk. Everything in it is whole at any moment but the log's last line, which a kill may tear.

    path: the folder. manifest: what decides the numbers (versions, spec, seed, machine).
    config: the algorithm's options.
    """

    def __init__(self, path: Path, manifest: dict[str, Any], config: dict[str, Any]) -> None:
        self.path = path
        self.manifest = manifest
        self.config = config
        self._progress = ProgressLog(path / "progress.csv")
        self._events = EventLog(path)

    @classmethod
    def create(cls, path: Path | str, *, manifest: Mapping[str, Any], config: Mapping[str, Any]) -> RunDirectory:
        """Make a new run directory. Raises RunError when `path` exists and is not an empty folder."""
        path = Path(path)
        if path.exists() and not (path.is_dir() and not any(path.iterdir())):
            raise RunError(f"{path}: exists and is not empty: choose another folder, or resume the run with --resume")
        whole, made = {"format": FORMAT, **manifest}, not path.exists()
        try:
            _describe(path, whole, config)
        except BaseException:
            with contextlib.suppress(OSError):
                if made:
                    path.rmdir()
            raise
        return cls(path, whole, dict(config))

    @classmethod
    def open(cls, path: Path | str) -> RunDirectory:
        """Open an existing run directory. Raises RunError when it is missing, foreign or its manifest is corrupt."""
        path = Path(path)
        if not path.is_dir():
            raise RunError(f"{path}: no such run directory: `guard train --out {path}` makes one")
        if not (path / "manifest.json").exists():
            raise RunError(f"{path}: has no manifest.json, so it is not a run directory of GUARD: check the path")
        remedy = "restore it from a copy, or train again into another folder"
        manifest = read_json(path / "manifest.json", remedy)
        if manifest.get("format") != FORMAT:
            found = manifest.get("format")
            raise RunError(f"{path / 'manifest.json'}: format {found!r} is not {FORMAT!r}: not a run of this GUARD")
        return cls(path, manifest, read_json(path / "config.json", remedy))

    def fact(self, key: str) -> Any:
        """Return what the manifest says under `key`. Raises RunError where it says nothing."""
        if key not in self.manifest:
            raise RunError(f"{self.path / 'manifest.json'}: has no {key}: restore it from a copy, or train again")
        return self.manifest[key]

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes from training here for the block. Raises RunError where one is at it.

        The system releases the lock of a killed process. Where the file system has no locks, none is kept away.
        """
        if os.name != "posix":
            yield
            return
        import fcntl  # noqa: PLC0415  there is none elsewhere

        handle = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise RunError(f"{self.path}: another process is training here: wait, or choose another folder") from None
        except OSError:
            pass
        try:
            yield
        finally:
            os.close(handle)

    def set_total_steps(self, total_steps: int) -> None:
        """Say in the manifest that the training now goes to `total_steps`."""
        self.manifest["total_steps"] = total_steps
        write_json(self.path / "manifest.json", self.manifest)

    def restart(self, *, manifest: Mapping[str, Any], config: Mapping[str, Any]) -> RunDirectory:
        """Begin the run anew in its folder and return it; files that a run does not write stay as they are."""
        self._delete_results()
        whole = {"format": FORMAT, **manifest}
        _describe(self.path, whole, config)
        return RunDirectory(self.path, whole, dict(config))

    def delete(self) -> None:
        """Delete the files that a run writes, and the folder where nothing else is in it."""
        self._delete_results()
        with disk_errors(self.path):
            for name in ("config.json", "manifest.json"):
                (self.path / name).unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # holds a file of the user
                self.path.rmdir()

    def _delete_results(self) -> None:
        """Delete log, events and checkpoints."""
        self.close()
        checkpoints = self.path / "checkpoints"
        with disk_errors(self.path):
            for file in (self.path / "progress.csv", *self.path.glob("events.out.tfevents.*")):
                file.unlink(missing_ok=True)
            for folder in (*self.checkpoints(), checkpoints / BEST, *checkpoints.glob(".*.tmp")):
                if folder.is_dir():
                    shutil.rmtree(folder)
            if checkpoints.is_dir() and not any(checkpoints.iterdir()):
                checkpoints.rmdir()

    def log(self, row: Mapping[str, float]) -> None:
        """Append one row, with the keys `epoch` and `total_steps`, to progress.csv and the TensorBoard events."""
        missing = set(KEYS) - row.keys()
        if missing:
            raise ValueError(f"a metrics row needs {sorted(missing)}")
        self._progress.append(row)
        self._events.append(row)

    def rows(self) -> list[dict[str, float]]:
        """Return the logged rows, oldest first."""
        return self._progress.rows()

    def truncate_log(self, epoch: int) -> None:
        """Drop the rows of epochs after `epoch`, when training goes on from that epoch's checkpoint."""
        self._progress.truncate(epoch)
        rows = self.rows()
        self._events.purge_from = int(rows[-1]["total_steps"]) + 1 if rows else 0

    def save_checkpoint(self, epoch: int, tensors: Mapping[str, np.ndarray], state: Mapping[str, Any]) -> Path:
        """Write `checkpoints/<epoch>/` whole or not at all, then delete all but the newest `KEPT_CHECKPOINTS`.

        Raises RunError on a full disk; the checkpoints before it stay.
        """
        path = self.path / "checkpoints" / f"{epoch:06d}"
        save_checkpoint(path, tensors, state)
        with disk_errors(path.parent):
            for old in self.checkpoints()[:-KEPT_CHECKPOINTS]:
                shutil.rmtree(old)
            for leftover in path.parent.glob(".*.tmp"):  # of a kill in the middle of an earlier write
                shutil.rmtree(leftover)
        return path

    def save_best(self, tensors: Mapping[str, np.ndarray], state: Mapping[str, Any]) -> Path:
        """Write `checkpoints/best/`, the best policy so far by the algorithm's rule, in place of the one before."""
        path = self.path / "checkpoints" / BEST
        save_checkpoint(path, tensors, state)
        return path

    def best_checkpoint(self) -> Path | None:
        """Return the best policy's checkpoint, which cannot be resumed; None where the algorithm keeps none."""
        path = self.path / "checkpoints" / BEST
        return path if path.is_dir() else None

    def checkpoints(self) -> list[Path]:
        """Return the checkpoints, oldest first."""
        folder = self.path / "checkpoints"
        if not folder.is_dir():
            return []
        found = (path for path in folder.iterdir() if NUMBERED.fullmatch(path.name))
        return sorted(found, key=lambda path: int(path.name))

    def last_checkpoint(self) -> Path | None:
        """Return the newest checkpoint, or None when there is none yet."""
        checkpoints = self.checkpoints()
        return checkpoints[-1] if checkpoints else None

    def close(self) -> None:
        """Close the TensorBoard file; the object stays usable."""
        self._events.close()


def _describe(folder: Path, manifest: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Write what the run is. The folder itself stays: it may be a link, or where a disk is mounted."""
    files = {"config.json": dict(config), "manifest.json": manifest}
    try:
        for name, data in files.items():
            write_json(folder / name, data)
    except BaseException:
        for name in files:  # half a description would block the folder
            with contextlib.suppress(OSError):
                (folder / name).unlink(missing_ok=True)
        raise
