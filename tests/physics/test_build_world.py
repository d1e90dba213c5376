"""How many workers, and of which kind."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.errors import SpecError
from guard_api.physics.backend import Capabilities
from guard_api.physics.build import WORLDS_PER_WORKER, build_world, default_workers
from guard_api.physics.shard import ShardedWorld
from guard_api.scene.spec import SceneSpec
from guard_api.testing import robots
from guard_api.testing.ideal import IdealBackend
from guard_api.testing.ideal import backend as ideal
from guard_api.testing.ideal.world import IdealWorld

SCENE = SceneSpec(robot=robots.pendulum())


class Threaded(IdealBackend):
    """An engine with threads of its own, which reports how many it was given."""

    capabilities = Capabilities(contacts=False, threads=True)
    threads = 0

    def build(self, scene: SceneSpec, num_worlds: int, threads: int = 1) -> IdealWorld:
        self.threads = threads
        return super().build(scene, num_worlds)


def test_one_worker_is_this_process() -> None:
    assert isinstance(build_world(ideal, SCENE, 8, 1), IdealWorld)


def test_more_workers_are_processes_but_never_more_than_worlds() -> None:
    world = build_world(ideal, SCENE, 2, 5)
    try:
        assert isinstance(world, ShardedWorld)
        assert len(world.snapshot()) > 0
        assert np.shape(world.state().time) == (2,)
    finally:
        world.close()


def test_threads_are_preferred_where_the_backend_has_them() -> None:
    backend = Threaded()
    assert isinstance(build_world(backend, SCENE, 8, 3), IdealWorld)
    assert backend.threads == 3


def test_small_jobs_stay_in_this_process() -> None:
    assert default_workers(1) == default_workers(2 * WORLDS_PER_WORKER - 1) == 1
    assert isinstance(build_world(ideal, SCENE, 3), IdealWorld)


def test_large_jobs_use_every_core_of_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: set(range(6)))
    assert default_workers(64) == 6
    assert default_workers(4 * WORLDS_PER_WORKER) == 4


@pytest.mark.parametrize(
    ("num_worlds", "workers", "field"), [(0, 1, "num_worlds"), (4, 0, "workers"), (4, -1, "workers")]
)
def test_nonsense_is_refused(num_worlds: int, workers: int, field: str) -> None:
    with pytest.raises(SpecError, match=field):
        build_world(ideal, SCENE, num_worlds, workers)
