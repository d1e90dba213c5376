"""C11: a snapshot returns a world to where it was, in this world or in an equal one."""

from __future__ import annotations

from guard_api.errors import BackendError
from guard_api.physics.backend import Backend, World
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, check, count, error
from guard_api.testing.checks.stepping import Values, moving_tree, pushing, swing, untouched
from guard_api.testing.scenes import differing, pendulum, robot_scene, running, tree


def _falling_tree() -> tuple[SceneSpec, Values]:
    return robot_scene(tree(damping=0.1), gravity=(0.0, 0.0, -9.81)), moving_tree(2)


@check("C11", exact_snapshot=True)
def restore_repeats(backend: Backend) -> list[Finding]:
    """Snapshot, restore and the same steps give the bits of the uninterrupted run, also in another equal world."""
    scene, start = _falling_tree()
    return _repeats(backend, scene, start)


@check("C11", contacts=True, exact_snapshot=True)
def restore_repeats_in_contact(backend: Backend) -> list[Finding]:
    """Snapshot, restore and the same steps give the bits of the uninterrupted run while things touch."""
    scene, start = pushing()
    return _repeats(backend, scene, start)


def _repeats(backend: Backend, scene: SceneSpec, start: Values) -> list[Finding]:
    with running(backend, scene, 2, **start) as world, running(backend, scene, 2, **start) as other:
        swing(world, 20)
        blob, there = world.snapshot(), world.state()
        swing(world, 15)
        onward = world.state()
        world.restore(blob)
        back = world.state()
        swing(world, 15)
        again = world.state()
        swing(other, 3)
        other.restore(blob)
        swing(other, 15)
        elsewhere = other.state()
    return [
        count("arrays that differ right after restore", differing(there, back)),
        count("arrays that differ 15 steps later", differing(onward, again)),
        count("arrays that differ in an equal world", differing(onward, elsewhere)),
        untouched(there, onward),
    ]


@check("C11")
def restore_returns(backend: Backend) -> list[Finding]:
    """Restoring returns positions and velocities, to float32 rounding even where bits are not promised."""
    scene, start = _falling_tree()
    with running(backend, scene, 2, **start) as world:
        swing(world, 20)
        blob, there = world.snapshot(), world.state()
        swing(world, 15)
        world.restore(blob)
        back = world.state()
    names = ("time", "joint_position", "joint_velocity", "link_position", "link_linear_velocity")
    return [error(name, getattr(back, name), getattr(there, name), 1e-5) for name in names]


@check("C11")
def restored_runs_agree(backend: Backend) -> list[Finding]:
    """All runs restored from one snapshot give the same bits, in the world it came from and in an equal one."""
    return _agree(backend, *_falling_tree())


@check("C11", contacts=True)
def restored_runs_agree_in_contact(backend: Backend) -> list[Finding]:
    """All runs restored from one snapshot give the same bits while things touch."""
    return _agree(backend, *pushing())


def _agree(backend: Backend, scene: SceneSpec, start: Values) -> list[Finding]:
    with running(backend, scene, 2, **start) as world, running(backend, scene, 2, **start) as other:
        swing(world, 20)
        blob, seen = world.snapshot(), world.state()
        ends = []
        for place, detour in ((world, 7), (world, 2), (other, 3)):
            swing(place, detour)
            place.restore(blob)
            swing(place, 15)
            ends.append(place.state())
    return [
        count("arrays that differ in a second run", differing(ends[0], ends[1])),
        count("arrays that differ in an equal world", differing(ends[0], ends[2])),
        untouched(seen, ends[0]),
    ]


@check("C11")
def foreign_snapshots_refused(backend: Backend) -> list[Finding]:
    """Noise, a cut snapshot, one of another scene or of fewer worlds raises BackendError, and harms nothing."""
    scene, start = _falling_tree()
    with running(backend, robot_scene(pendulum())) as other:
        foreign = other.snapshot()
    with running(backend, scene, 1) as other:
        fewer = other.snapshot()
    with running(backend, scene, 2, **start) as world:
        swing(world, 3)
        own, before = world.snapshot(), world.state()
        blobs = {"noise": b"not a snapshot", "empty": b"", "cut": own[:-8], "another scene": foreign, "fewer": fewer}
        accepted = [name for name, blob in blobs.items() if not _refuses(world, blob)]
        harmed = differing(before, world.state())
    return [count("foreign snapshots accepted", accepted), count("arrays changed by refused ones", harmed)]


def _refuses(world: World, blob: bytes) -> bool:
    try:
        world.restore(blob)
    except BackendError:
        return True
    return False
