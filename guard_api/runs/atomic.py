"""Files that are whole or not there: written beside their place, flushed to the disk, then renamed into it."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from guard_api.errors import RunError


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` to `path`; a crash or a full disk leaves the old file. Raises RunError when it cannot be written."""
    path = Path(path)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.chmod(0o644)  # mkstemp makes it private; results are shared
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 to `path`, atomically. Raises RunError when it cannot be written."""
    write_bytes(path, text.encode())


def write_json(path: Path, data: Any) -> None:
    """Write `data` as indented JSON to `path`, atomically. Raises RunError when it cannot be written."""
    write_text(path, json.dumps(data, indent=1) + "\n")


def read_json(path: Path, remedy: str) -> dict[str, Any]:
    """Return the JSON object in `path`. Raises RunError naming the file and `remedy` when it is missing or corrupt."""
    path = Path(path)
    try:
        data = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise RunError(f"{path}: no such file: {remedy}") from None
    except OSError as error:
        raise RunError(f"{path}: cannot be read ({error.strerror}): {remedy}") from error
    except ValueError as error:
        raise RunError(f"{path}: not valid JSON ({error}): {remedy}") from error
    if not isinstance(data, dict):
        raise RunError(f"{path}: holds a JSON {type(data).__name__}, not an object: {remedy}")
    return data


def write_folder(path: Path, fill: Callable[[Path], None]) -> None:
    """Make the folder `path` whole or not at all: `fill` writes into a folder beside it, which is then renamed.

    A folder already at `path` is replaced. Raises RunError when the disk refuses.
    """
    path = Path(path)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent))
        try:
            temporary.chmod(0o755)
            fill(temporary)
            sync_folder(temporary)
            with _out_of_the_way(path):
                temporary.rename(path)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        sync_folder(path.parent)


@contextlib.contextmanager
def _out_of_the_way(path: Path) -> Iterator[None]:
    """Move what is at `path` aside for the block, then delete it; put it back where the block fails."""
    if not path.exists():
        yield
        return
    aside = path.with_name(f".{path.name}.{os.getpid()}.old.tmp")
    path.rename(aside)
    try:
        yield
    except BaseException:
        aside.rename(path)
        raise
    shutil.rmtree(aside)


def sync_folder(path: Path) -> None:
    """Flush a folder's list of names to the disk, where the system can: a rename is only then safe from a power cut."""
    if os.name != "posix":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn an OSError met while writing `path` into a RunError of one line with a remedy; what was there is kept."""
    try:
        yield
    except OSError as error:
        full = error.errno in {errno.ENOSPC, errno.EDQUOT}
        remedy = "free some space" if full else "check the path and its permissions"
        again = "then run the same command again (a `guard train` with --resume): what was written before is kept"
        raise RunError(f"{path}: cannot be written ({error.strerror or error}): {remedy}, {again}") from error
