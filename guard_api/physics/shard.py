"""A world whose N worlds are spread over worker processes, for engines that hold the interpreter lock while stepping.

Workers are fresh interpreters. A `fork` would copy the locks of threads that do not survive it (those of torch and
of BLAS among them) and deadlock sooner or later; the `spawn` and `forkserver` of `multiprocessing` import the
caller's main module again, so that a script without a main guard would build its environments again in each worker.

Per step and worker one small message goes each way; arrays lie in memory that all share. World i is computed by the
same code from the same numbers as without workers, so its bits are the same.
"""

from __future__ import annotations

import hashlib
import os
import select
import signal
import struct
import subprocess
import sys
import weakref
from collections.abc import Sequence
from itertools import pairwise
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.physics.backend import CLOSED, Backend
from guard_api.physics.shard_worker import Job
from guard_api.physics.shared_arrays import SharedArrays
from guard_api.physics.state import Array, Inspection, Mask, Start, State
from guard_api.scene.spec import SceneSpec

_GRACE = 5.0
"""Seconds that a worker has to end by itself once its pipe is closed."""

REPLY_TIMEOUT = 600.0
"""Seconds in which a worker must answer: far more than it takes to build or step hundreds of worlds on a busy machine.
An engine that hangs takes for ever."""

_PUBLISHING = frozenset({"reset", "step", "restore", "publish"})
"""Calls after which a worker's share of the state lies in the shared arrays."""

_SINGLE_THREADED = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class ShardedWorld:
    """`num_worlds` copies of `scene` on `backend`, in `workers` processes (at most one per world).

    A worker that raises, dies, or does not answer within `REPLY_TIMEOUT` raises BackendError here that names it and its
    worlds; after a death or a hang only `close` works. A snapshot fits a world with the same number of workers.
    """

    def __init__(self, backend: Backend, scene: SceneSpec, num_worlds: int, workers: int) -> None:
        if os.name != "posix":
            raise BackendError("worker processes need a POSIX system: use workers=1")
        self.scene, self.num_worlds = scene, num_worlds
        self._backend, self._broken, self._stale = backend.name, "", True
        bounds = np.linspace(0, num_worlds, min(workers, num_worlds) + 1).astype(int).tolist()
        self._rows = [slice(first, last) for first, last in pairwise(bounds)]
        self._drivable = [group.name for group in scene.groups if group.body.physics == "driven"]
        self._driven: set[str] = set()
        self._processes: list[subprocess.Popen[bytes]] = []
        self._pipes: list[Connection] = []
        self._arrivals: list[select.poll] = []  # made once: `Connection.poll` makes one per call, ten times slower
        self._release = weakref.finalize(self, _release, self._processes, self._pipes)
        memory = SharedArrays.allocate(scene, num_worlds)
        self._memory = SharedArrays(scene, num_worlds, memory)
        try:
            for rows in self._rows:
                self._start(rows, memory)
            approximations = self._collect(range(len(self._rows)))
        except BaseException:
            self.close()
            raise
        finally:
            os.close(memory)
        self.approximations: tuple[str, ...] = approximations[0]

    def reset(self, mask: Mask, start: Start) -> None:
        """Start the worlds where `mask` (N,) is true from the rows of `start`."""
        self._arrays["mask"][...] = mask
        self._arrays.set_start(start)
        everyone = bool(self._driven)  # a drive must come before the reset in every worker
        self._ask("reset", {k: () for k, rows in enumerate(self._rows) if everyone or mask[rows].any()})

    def step(self, control: NDArray[np.floating], substeps: int) -> None:
        """Advance all worlds by `substeps` timesteps under `control` (N, U)."""
        if np.shape(control) != self._arrays["control"].shape:
            expected = self._arrays["control"].shape
            raise BackendError(f"control has shape {np.shape(control)}: give one row per world, {expected}")
        self._arrays["control"][...] = control
        self._ask("step", self._all(substeps))

    def drive(self, group: str, position: Array, quaternion: Array) -> None:
        """Let the driven bodies of `group` reach (N, count, 3), (N, count, 4) by the end of the next `step`."""
        if group not in self._drivable:
            raise BackendError(
                f"{group!r} is no group of driven bodies: {', '.join(self._drivable) or 'there is none'}"
            )
        self._arrays[f"drive.{group}.position"][...] = position
        self._arrays[f"drive.{group}.quaternion"][...] = quaternion
        self._driven.add(group)

    def state(self) -> State:
        """Return the present state."""
        if self._stale:
            self._ask("publish", self._all())
        return self._arrays.state()

    def snapshot(self) -> bytes:
        """Return the workers' snapshots, headed by a digest of backend, scene, N and the number of workers."""
        blobs = self._ask("snapshot", self._all())
        return self._fingerprint() + struct.pack(f"<{len(blobs)}Q", *map(len, blobs)) + b"".join(blobs)

    def restore(self, blob: bytes) -> None:
        """Return to a snapshot of an equal world with as many workers. Raises BackendError for anything else."""
        head, count = self._fingerprint(), len(self._rows)
        body = len(head) + 8 * count
        lengths = struct.unpack_from(f"<{count}Q", blob, len(head)) if len(blob) >= body else ()
        if not blob.startswith(head) or not lengths or len(blob) != body + sum(lengths):
            raise BackendError(
                f"not a snapshot of {self.num_worlds} worlds of this scene on {self._backend!r} in {count} workers"
            )
        ends = np.cumsum([body, *lengths]).tolist()
        self._ask("restore", {worker: (blob[i:j],) for worker, (i, j) in enumerate(pairwise(ends))})

    def inspect(self, world: int) -> Inspection:
        """Return what the engine holds for one world."""
        worker = next(k for k, rows in enumerate(self._rows) if rows.start <= world < rows.stop)
        return self._ask("inspect", {worker: (world - self._rows[worker].start,)})[0]

    def step_raw(self, substeps: int) -> None:
        """Run the bare engines under the last control; the state is fetched when it is asked for."""
        self._stale = True
        self._ask("step_raw", self._all(substeps))

    def close(self) -> None:
        """End the workers and free the memory."""
        self._broken = self._broken or CLOSED
        self._release()
        self._memory.close()

    @property
    def _arrays(self) -> SharedArrays:
        if self._broken:
            raise BackendError(self._broken)
        return self._memory

    def _start(self, rows: slice, memory: int) -> None:
        pipe, theirs = Pipe()
        code = (
            # Ctrl-C, and what ends a whole job, are the parent's to handle: it may want to save something first.
            "import signal, sys; "
            "signal.signal(signal.SIGINT, signal.SIG_IGN); signal.signal(signal.SIGTERM, signal.SIG_IGN); "
            f"sys.path[:] = {sys.path!r}; from guard_api.physics.shard_worker import main; "
            f"main({theirs.fileno()}, {memory})"
        )
        # What an engine prints goes to the error stream: the output stream may carry JSON.
        process = subprocess.Popen(
            [sys.executable, "-c", code],
            pass_fds=(theirs.fileno(), memory),
            stdin=subprocess.DEVNULL,
            stdout=2,
            env=os.environ | _SINGLE_THREADED,
        )
        self._processes.append(process)
        self._pipes.append(pipe)
        self._arrivals.append(select.poll())
        self._arrivals[-1].register(pipe, select.POLLIN)
        theirs.close()  # so that the worker's death is the end of the stream
        job = Job(backend=self._backend, scene=self.scene, num_worlds=self.num_worlds, first=rows.start, last=rows.stop)
        self._send(len(self._pipes) - 1, job)

    def _all(self, *arguments: Any) -> dict[int, tuple[Any, ...]]:
        """Return the same arguments for every worker."""
        return dict.fromkeys(range(len(self._rows)), arguments)

    def _ask(self, method: str, arguments: dict[int, tuple[Any, ...]]) -> list[Any]:
        """Call `method` in the workers that have `arguments`, all at the same time; return their results in order."""
        if self._broken:
            raise BackendError(self._broken)
        everyone = len(arguments) == len(self._rows)
        driven = tuple(sorted(self._driven)) if everyone else ()
        self._broken = "the world was interrupted in the middle of a call: close it"
        for worker, passed in arguments.items():
            self._send(worker, (method, passed, driven))
        results = self._collect(list(arguments))
        self._driven.difference_update(driven)
        if everyone and method in _PUBLISHING:
            self._stale = False
        return results

    def _send(self, worker: int, message: Any) -> None:
        try:
            self._pipes[worker].send(message)
        except ConnectionError:
            self._died(worker)

    def _collect(self, workers: Sequence[int]) -> list[Any]:
        """Return the replies of `workers`, all of them read before the first failure is raised."""
        replies = []
        for worker in workers:
            try:
                if not self._arrivals[worker].poll(REPLY_TIMEOUT * 1000):
                    self._hangs(worker)
                replies.append(self._pipes[worker].recv())
            except (EOFError, ConnectionError):
                self._died(worker)
        self._broken = ""
        for worker, (succeeded, result) in zip(workers, replies, strict=True):
            if not succeeded:
                line, trace = result
                error = BackendError(f"{self._label(worker)}: {line}")
                error.add_note(trace)
                raise error
        return [result for _, result in replies]

    def _died(self, worker: int) -> None:
        """Release everything and raise BackendError saying how `worker` ended."""
        try:
            code = self._processes[worker].wait(_GRACE)
        except subprocess.TimeoutExpired:
            code = None
        ended = f"killed by {signal.Signals(-code).name}" if code and code < 0 else f"exit code {code}"
        self._broken = f"{self._label(worker)} died ({ended}): its worlds are lost, build them anew"
        self._release()
        raise BackendError(self._broken) from None

    def _hangs(self, worker: int) -> None:
        """Release everything and raise BackendError saying that `worker` does not answer."""
        self._broken = (
            f"{self._label(worker)} has not answered for {REPLY_TIMEOUT:g} s, and was killed: its engine hangs, or "
            "the machine is overloaded: build another world, with fewer worlds or workers if it happens again"
        )
        for process in self._processes:
            process.kill()  # one that hangs does not see its pipe close
        self._release()
        raise BackendError(self._broken)

    def _label(self, worker: int) -> str:
        rows = self._rows[worker]
        return f"worker {worker} of {self._backend!r} (worlds {rows.start} to {rows.stop - 1})"

    def _fingerprint(self) -> bytes:
        key = repr((self._backend, self.scene, self.num_worlds, len(self._rows)))
        return hashlib.blake2b(key.encode(), digest_size=16).digest()


def _release(processes: list[subprocess.Popen[bytes]], pipes: list[Connection]) -> None:
    """Close the pipes, which ends the workers, and wait for them; kill those that do not end."""
    for pipe in pipes:
        pipe.close()
    for process in processes:
        try:
            process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
