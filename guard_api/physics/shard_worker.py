"""One worker of a sharded world: it builds its share and does what the parent asks, until the pipe closes.

A request is (method, arguments, groups driven since the last one); a reply is (True, result) or
(False, (one line, traceback)). Arrays travel through `SharedArrays`.
"""

from __future__ import annotations

import os
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from guard_api import plugins
from guard_api.physics.backend import World
from guard_api.physics.shared_arrays import SharedArrays
from guard_api.scene.spec import SceneSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What a worker is for: worlds `first` to `last` (exclusive) of `num_worlds`, on the backend of that name."""

    backend: str
    scene: SceneSpec
    num_worlds: int
    first: int
    last: int


def main(pipe: int, memory: int) -> None:
    """Serve the parent at the other end of descriptor `pipe`; return when it closes its end or dies."""
    with Connection(pipe) as connection:
        try:
            job: Job = connection.recv()
            worker = _Worker(job, SharedArrays(job.scene, job.num_worlds, memory))
            os.close(memory)
        except Exception as error:  # noqa: BLE001 - whatever a plugin raises must reach the parent
            connection.send((False, _described(error)))
            return
        connection.send((True, worker.world.approximations))
        try:
            while True:
                connection.send(worker.answer(*connection.recv()))
        except (EOFError, ConnectionError):
            pass  # the parent has closed its end: the end of the job
        finally:
            worker.world.close()


class _Worker:
    """A share of the worlds, and the rows of the shared arrays that are theirs."""

    def __init__(self, job: Job, arrays: SharedArrays) -> None:
        self._rows, self._arrays = slice(job.first, job.last), arrays
        self.world: World = plugins.load("guard.backends", job.backend).build(job.scene, job.last - job.first)

    def answer(self, method: str, arguments: tuple[Any, ...], driven: tuple[str, ...]) -> tuple[bool, Any]:
        """Return the reply to one request."""
        try:
            for group in driven:
                targets = (self._arrays[f"drive.{group}.{pose}"] for pose in ("position", "quaternion"))
                self.world.drive(group, *(target[self._rows].copy() for target in targets))
            return True, getattr(self, f"_{method}")(*arguments)
        except Exception as error:  # noqa: BLE001 - whatever an engine raises must reach the parent
            return False, _described(error)

    def _reset(self) -> None:
        self.world.reset(self._arrays["mask"][self._rows].copy(), self._arrays.start(self._rows))
        self._publish()

    def _step(self, substeps: int) -> None:
        self.world.step(self._arrays["control"][self._rows].copy(), substeps)
        self._publish()

    def _restore(self, blob: bytes) -> None:
        self.world.restore(blob)
        self._publish()

    def _publish(self) -> None:
        self._arrays.set_state(self.world.state(), self._rows)

    def _snapshot(self) -> bytes:
        return self.world.snapshot()

    def _inspect(self, world: int) -> Any:
        return self.world.inspect(world)

    def _step_raw(self, substeps: int) -> None:
        self.world.step_raw(substeps)


def _described(error: Exception) -> tuple[str, str]:
    """Return the error as one line, and its traceback."""
    line = str(error).splitlines()[0] if str(error) else ""
    return f"{type(error).__name__}: {line}", traceback.format_exc()
