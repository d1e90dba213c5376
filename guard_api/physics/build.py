"""Build a world with as much parallelism as the machine and the backend offer."""

from __future__ import annotations

import os

from guard_api.errors import SpecError
from guard_api.physics.backend import Backend, World
from guard_api.physics.shard import ShardedWorld
from guard_api.scene.spec import SceneSpec

WORLDS_PER_WORKER = 8
"""Fewest worlds per worker chosen automatically.

With up to about 8 worlds a step is mostly NumPy's overhead per call, which every worker pays in full: 8 Point worlds
were slower on two workers than on one, in Bullet and in SAPIEN.
"""


def build_world(backend: Backend, scene: SceneSpec, num_worlds: int, workers: int | None = None) -> World:
    """Build `num_worlds` copies of `scene` on `backend`, stepped by `workers` threads or processes.

    workers: None chooses `default_workers(num_worlds)`. They are threads of this process where the backend's
    capabilities say so, else processes, except that one worker is this process. The numbers are the same either way.
    Raises SpecError for no worlds or no workers, BackendError for what the engine cannot build.
    """
    for name, value in (("num_worlds", num_worlds), ("workers", workers)):
        if value is not None and value < 1:
            raise SpecError(f"{name} is {value}: it must be at least 1")
    count = min(workers or default_workers(num_worlds), num_worlds)
    if backend.capabilities.threads:
        return backend.build(scene, num_worlds, threads=count)
    return ShardedWorld(backend, scene, num_worlds, count) if count > 1 else backend.build(scene, num_worlds)


def default_workers(num_worlds: int) -> int:
    """Return one worker per core that this process may use, but none with less than `WORLDS_PER_WORKER` worlds."""
    return max(1, min(usable_cores(), num_worlds // WORLDS_PER_WORKER))


def usable_cores() -> int:
    """Return how many cores this process may use, which can be fewer than the machine has."""
    affinity = getattr(os, "sched_getaffinity", None)  # Linux only
    return len(affinity(0)) if affinity else os.cpu_count() or 1
