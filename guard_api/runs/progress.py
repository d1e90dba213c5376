"""The metrics log of a run: `progress.csv`, one row per epoch, which survives a kill at any byte."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from guard_api.errors import RunError
from guard_api.runs.atomic import disk_errors, write_text

KEYS = ("epoch", "total_steps")
"""What every row holds."""


class ProgressLog:
    """Rows of named numbers in a CSV file. Numbers are written so that reading returns the same bits.

    Opening it drops a torn last line, which only a kill in the middle of a write can leave.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._drop_torn_line()

    def append(self, row: Mapping[str, float]) -> None:
        """Append one row and flush it to the disk; a new column is added to the rows before it, empty.

        Raises RunError on a full disk; the rows before it stay.
        """
        columns = self.columns()
        new = [name for name in row if name not in columns]
        if new:
            self._write(columns + new, [*self.rows(), row])
            return
        size = self.path.stat().st_size
        with disk_errors(self.path):
            try:
                with self.path.open("a", newline="") as file:
                    file.write(_line(columns, row))
                    file.flush()
                    os.fsync(file.fileno())
            except OSError:
                os.truncate(self.path, size)
                raise

    def columns(self) -> list[str]:
        """Return the names of the columns, in the order of the file."""
        if not self.path.exists():
            return []
        return next(csv.reader(io.StringIO(_text(self.path))), [])

    def rows(self) -> list[dict[str, float]]:
        """Return every row, without its empty columns. Raises RunError for a cell that is not a number."""
        return read_rows(self.path)

    def truncate(self, epoch: int) -> None:
        """Drop every row whose `epoch` is greater than `epoch`, atomically."""
        rows = self.rows()
        kept = [row for row in rows if row["epoch"] <= epoch]
        if len(kept) < len(rows):
            self._write(self.columns(), kept)

    def _write(self, columns: Sequence[str], rows: Sequence[Mapping[str, float]]) -> None:
        header = io.StringIO()
        csv.writer(header, lineterminator="\n").writerow(columns)
        write_text(self.path, header.getvalue() + "".join(_line(columns, row) for row in rows))

    def _drop_torn_line(self) -> None:
        if not self.path.exists():
            return
        data = self.path.read_bytes()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            with disk_errors(self.path):
                os.truncate(self.path, whole)


def read_rows(path: Path) -> list[dict[str, float]]:
    """Return the rows of the log at `path`, none where there is no file; changes nothing, so a run may be writing it.

    A torn last line is left out, and so are empty columns. Raises RunError for a file that is no text, a cell that is
    not a number, and epochs that do not rise, as when two trainings wrote into one file.
    """
    if not path.exists():
        return []
    text = _text(path)
    whole = io.StringIO(text[: text.rfind("\n") + 1])
    rows: list[dict[str, float]] = []
    missing = [name for name in KEYS if name not in text.partition("\n")[0].split(",")]
    if missing:
        raise RunError(f"{path}:1: has no column {missing[0]}, so it is no log of a training: restore it from a copy")
    for number, cells in enumerate(csv.DictReader(whole), start=2):
        rows.append(_parse(path, cells, number))
        if len(rows) > 1 and rows[-1]["epoch"] <= rows[-2]["epoch"]:
            raise RunError(
                f"{path}:{number}: epoch {rows[-1]['epoch']:g} after {rows[-2]['epoch']:g}: repair or delete this line"
            )
    return rows


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"{path}: cannot be read ({error}): restore it from a copy") from error


def _parse(path: Path, cells: Mapping[str, str | None], number: int) -> dict[str, float]:
    try:
        row = {name: float(text) for name, text in cells.items() if text}
    except (TypeError, ValueError) as error:
        raise RunError(f"{path}:{number}: {error}: repair or delete this line") from error
    missing = [name for name in KEYS if name not in row]
    if missing:
        raise RunError(f"{path}:{number}: no {missing[0]}: repair or delete this line")
    return row


def _line(columns: Sequence[str], row: Mapping[str, float]) -> str:
    return ",".join(_number(row[name]) if name in row else "" for name in columns) + "\n"


def _number(value: float) -> str:
    value = float(value)
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
