"""TensorBoard events of a run, written without a background thread so that a full disk is an error and not a hang."""

from __future__ import annotations

import time
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from guard_api.runs.atomic import disk_errors

if TYPE_CHECKING:
    from tensorboardX.event_file_writer import EventsWriter


class EventLog:
    """Scalars against `total_steps`. The event file is made, and tensorboardX imported, by the first `append`.

    purge_from: the step from which TensorBoard shall forget what an earlier, interrupted run of the same folder wrote.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.purge_from: int | None = None
        self._writer: EventsWriter | None = None

    def append(self, row: Mapping[str, float]) -> None:
        """Write every number of `row` but its two indices, and flush. Raises RunError on a full disk."""
        proto = import_module("tensorboardX.proto.event_pb2")  # not at the top: importing tensorboardX takes a second
        summary = import_module("tensorboardX.proto.summary_pb2")
        with disk_errors(self.folder):
            writer = self._open()
            if self.purge_from is not None:
                start = proto.SessionLog(status=proto.SessionLog.START)
                writer.write_event(proto.Event(wall_time=time.time(), step=self.purge_from, session_log=start))
                self.purge_from = None
            scalars = [
                summary.Summary.Value(tag=name, simple_value=float(value))
                for name, value in row.items()
                if name not in {"epoch", "total_steps"}
            ]
            step = int(row.get("total_steps", row.get("epoch", 0)))
            writer.write_event(proto.Event(wall_time=time.time(), step=step, summary=summary.Summary(value=scalars)))
            writer.flush()

    def close(self) -> None:
        """Close the event file; a later `append` begins a new one."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _open(self) -> EventsWriter:
        if self._writer is not None:
            return self._writer
        module = import_module("tensorboardX.event_file_writer")
        writer: EventsWriter = module.EventsWriter(str(self.folder / "events"), f".{time.time_ns()}")
        self._writer = writer
        return writer
