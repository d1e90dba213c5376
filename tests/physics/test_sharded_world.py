"""Worlds in worker processes: the same bits, errors that name the culprit, nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from guard_api import plugins
from guard_api.errors import BackendError
from guard_api.physics import shard
from guard_api.physics.shard import ShardedWorld
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start
from guard_api.testing import robots
from guard_api.testing.ideal import backend as ideal
from tests.physics.scenes import begin, bits, busy_scene, run

DUMMY = Path(__file__).parent.parent / "plugin/dummy_distribution"
pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
PENDULUM = SceneSpec(robot=robots.pendulum())
BREAKING, DYING, TALKING, HANGING = 100.0, 200.0, 300.0, 400.0  # what makes the dummy engine raise, die, print, hang


@pytest.fixture(scope="module")
def long_lived() -> Iterator[ShardedWorld]:
    """Five worlds in two workers, on the out-of-tree backend that fails on demand."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DUMMY))
        world = ShardedWorld(plugins.load("guard.backends", "dummy"), PENDULUM, 5, 2)
    yield world
    world.close()


@pytest.fixture
def fragile(long_lived: ShardedWorld) -> ShardedWorld:
    """The same worlds for every test that leaves them alive, started anew."""
    long_lived.reset(np.ones(5, bool), home_start(PENDULUM, 5))
    return long_lived


def demand(value: float, world: int) -> np.ndarray:
    control = np.zeros((5, 1))
    control[world] = value
    return control


def is_running(process: str) -> bool:
    try:
        state = Path("/proc", process, "stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"  # an orphan whose new parent has not looked yet is as dead


def children() -> set[int]:
    """Process ids of all children of this process, dead ones not yet waited for included."""
    return {
        int(child)
        for task in Path("/proc/self/task").iterdir()
        for child in (task / "children").read_text().split()
    }  # fmt: skip


def test_every_call_gives_the_bits_of_an_unsharded_world() -> None:
    """Uneven shares, selective resets, drives pending over a snapshot, raw steps: all as without workers."""
    alone, sharded = ideal.build(busy_scene(), 7), ShardedWorld(ideal, busy_scene(), 7, 3)
    try:
        seen = []
        for world in (alone, sharded):
            begin(world)
            states = [world.state(), run(world, 3)]
            world.reset(np.array([0, 0, 0, 1, 0, 0, 1], bool), home_start(world.scene, 7))
            states.append(world.state())
            world.drive("gremlins", np.ones((7, 3, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (7, 3, 1)))
            world.inspect(6)
            blob = world.snapshot()
            world.step(np.ones((7, 4)), 3)
            states.append(world.state())
            world.step_raw(4)
            states.append(world.state())
            world.restore(blob)
            world.step(np.ones((7, 4)), 3)
            states.append(world.state())
            seen.append([bits(state) for state in states])
        assert seen[0] == seen[1]
        assert seen[0][3] == seen[0][5]
        np.testing.assert_array_equal(alone.inspect(5).mass_matrix, sharded.inspect(5).mass_matrix)
    finally:
        sharded.close()


def test_states_belong_to_the_caller(fragile: ShardedWorld) -> None:
    first = fragile.state()
    kept = bits(first)
    fragile.step(demand(0.5, 0), 5)
    assert bits(first) == kept
    fragile.state().joint_position[:] = 7.0
    assert fragile.state().joint_position.max() < 7.0


def test_an_error_in_a_worker_names_worker_and_worlds_and_is_survived(fragile: ShardedWorld) -> None:
    with pytest.raises(BackendError, match=r"worker 1 of 'dummy' \(worlds 2 to 4\): RuntimeError: the dummy") as caught:
        fragile.step(demand(BREAKING, 3), 1)
    assert "in step" in caught.value.__notes__[0]
    fragile.reset(np.ones(5, bool), home_start(PENDULUM, 5))
    fragile.step(demand(0.0, 0), 1)
    assert fragile.state().ok.all()


def test_a_worker_that_dies_at_work_is_reported_and_everything_released(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DUMMY))
    before = children()
    world = ShardedWorld(plugins.load("guard.backends", "dummy"), PENDULUM, 5, 2)
    world.reset(np.ones(5, bool), home_start(PENDULUM, 5))
    message = r"worker 0 of 'dummy' \(worlds 0 to 1\) died \(killed by SIGKILL\)"
    with pytest.raises(BackendError, match=message):
        world.step(demand(DYING, 1), 1)
    assert children() == before
    for call in (world.state, world.snapshot, lambda: world.step(demand(0.0, 0), 1)):
        with pytest.raises(BackendError, match=message):
            call()
    world.close()


def test_a_worker_that_hangs_is_named_with_a_remedy_and_everything_released(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DUMMY))
    before = children()
    world = ShardedWorld(plugins.load("guard.backends", "dummy"), PENDULUM, 5, 2)
    world.reset(np.ones(5, bool), home_start(PENDULUM, 5))
    monkeypatch.setattr(shard, "REPLY_TIMEOUT", 0.5)
    message = r"worker 1 of 'dummy' \(worlds 2 to 4\) has not answered for 0.5 s.*build another world"
    with pytest.raises(BackendError, match=message) as caught:
        world.step(demand(HANGING, 4), 1)
    assert "\n" not in str(caught.value)
    assert children() == before
    with pytest.raises(BackendError, match=message):
        world.state()
    world.close()


def test_a_worker_killed_between_calls_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    before = children()
    world = ShardedWorld(ideal, PENDULUM, 4, 2)
    world.reset(np.ones(4, bool), home_start(PENDULUM, 4))
    for worker in children() - before:
        os.kill(worker, signal.SIGKILL)
    with pytest.raises(BackendError, match="killed by SIGKILL"):
        world.step(np.zeros((4, 1)), 1)
    assert children() == before


def test_closing_leaves_no_process_and_no_memory() -> None:
    before, files = children(), set(Path("/proc/self/fd").iterdir())
    shared = set(Path("/dev/shm").iterdir())
    world = ShardedWorld(ideal, PENDULUM, 4, 2)
    assert len(children() - before) == 2
    world.close()
    world.close()
    assert children() == before
    assert len(set(Path("/proc/self/fd").iterdir())) == len(files)
    assert set(Path("/dev/shm").iterdir()) <= shared
    with pytest.raises(BackendError, match="this world is closed: build another one"):
        world.step(np.zeros((4, 1)), 1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_workers_ignore_the_signals_that_the_parent_handles(fragile: ShardedWorld, number: int) -> None:
    for process in fragile._processes:
        process.send_signal(number)
    fragile.step(demand(0.1, 0), 2)
    assert fragile.state().ok.all()


SCRIPT = f"""
import os, sys
import numpy as np
sys.path.insert(0, {str(DUMMY)!r})
from guard_dummy import backend
from guard_api.physics.shard import ShardedWorld
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start
from guard_api.testing import robots

# No main guard, and the world is never closed.
scene = SceneSpec(robot=robots.pendulum())
world = ShardedWorld(backend, scene, 4, 2)
world.reset(np.ones(4, bool), home_start(scene, 4))
world.step(np.full((4, 1), {TALKING}), 1)
print(*[process.pid for process in world._processes], flush=True)
if "die" in sys.argv:
    os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize("end", ["live", "die"])
def test_no_worker_outlives_a_script(end: str, tmp_path: Path) -> None:
    """Neither a plain exit nor a killed parent leaves workers; what engines print stays out of the output."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run([sys.executable, script, end], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == (0 if end == "live" else -signal.SIGKILL), done.stderr
    workers = done.stdout.split()
    assert len(workers) == 2
    patience = time.monotonic() + 30.0  # a killed parent's workers end on their own time
    while any(is_running(worker) for worker in workers) and time.monotonic() < patience:
        time.sleep(0.01)
    assert not any(is_running(worker) for worker in workers)


def test_a_backend_without_entry_point_is_refused_with_nothing_left() -> None:
    class Stray(type(ideal)):
        name = "stray"

    before = children()
    with pytest.raises(BackendError, match=r"worker 0 of 'stray' \(worlds 0 to 1\): SpecError: unknown backend"):
        ShardedWorld(Stray(), PENDULUM, 4, 2)
    assert children() == before


def test_foreign_snapshots_are_refused(fragile: ShardedWorld) -> None:
    blob = fragile.snapshot()
    for damaged in (b"", b"noise", blob[:-1], blob + b"x"):
        with pytest.raises(BackendError, match="not a snapshot of 5 worlds"):
            fragile.restore(damaged)
    fragile.restore(blob)


def test_misuse_is_named(fragile: ShardedWorld) -> None:
    with pytest.raises(BackendError, match=r"control has shape \(1,\): give one row per world, \(5, 1\)"):
        fragile.step(np.zeros(1), 1)
    with pytest.raises(BackendError, match="'balls' is no group of driven bodies: there is none"):
        fragile.drive("balls", np.zeros((5, 1, 3)), np.zeros((5, 1, 4)))
