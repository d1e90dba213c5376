"""C9: worlds repeat themselves and depend on no other world."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

import numpy as np

from guard_api.physics.backend import Backend
from guard_api.physics.state import State
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, check, count
from guard_api.testing.checks.stepping import Values, moving_tree, pushing, swing, untouched
from guard_api.testing.scenes import differing, idle, rest_start, robot_scene, running, tree

EARTH = (0.0, 0.0, -9.81)


@check("C9")
def same_bits_twice(backend: Backend) -> list[Finding]:
    """Two builds of one scene give the same bits."""
    return _twice(backend, robot_scene(tree(damping=0.1), gravity=EARTH), moving_tree(2))


@check("C9", contacts=True)
def same_bits_twice_in_contact(backend: Backend) -> list[Finding]:
    """Two builds of one scene give the same bits while things touch."""
    return _twice(backend, *pushing())


def _twice(backend: Backend, scene: SceneSpec, start: Values) -> list[Finding]:
    states = []
    for _ in range(2):
        with running(backend, scene, 2, **start) as world:
            swing(world, 40)
            states.append(world.state())
    return [count("arrays that differ", differing(states[0], states[1])), untouched(*states)]


@check("C9")
def worlds_are_alone(backend: Backend) -> list[Finding]:
    """World i has the same bits among 1, 3 or 8 worlds, whatever the others do."""
    start = {name: np.asarray(value) for name, value in moving_tree(8).items()}
    return _alone(backend, robot_scene(tree(damping=0.1), gravity=EARTH), start)


@check("C9", contacts=True)
def worlds_are_alone_in_contact(backend: Backend) -> list[Finding]:
    """World i has the same bits among 1, 3 or 8 worlds while things touch, whatever the others do."""
    scene, start = pushing()
    speed = np.linspace(0.5, 2.0, 8)[:, None]
    place = np.broadcast_to(start["body_position"], (8, 1, 3))
    return _alone(backend, scene, {"joint_velocity": speed, "body_position": place})


def _alone(backend: Backend, scene: SceneSpec, start: dict[str, np.ndarray]) -> list[Finding]:
    findings = []
    last = _drive_rows(backend, scene, start, 8)
    for num_worlds in (1, 3):
        some = _drive_rows(backend, scene, start, num_worlds)
        for i in range(num_worlds):
            # World i of the few has the start and the controls of world i of the eight.
            findings.append(count(f"arrays of world {i} of {num_worlds} that differ", differing(some, last, worlds=i)))
    other = _drive_rows(backend, scene, start, 8, others=-1.0)
    findings.append(count("arrays of world 0 that others change", differing(other, last, worlds=0)))
    return [*findings, untouched(last)]


def _drive_rows(
    backend: Backend, scene: SceneSpec, start: dict[str, np.ndarray], num_worlds: int, others: float = 1.0
) -> State:
    """Return the state after 40 steps of a control of world i's own; `others` scales that of all worlds but 0."""
    with running(backend, scene, num_worlds, **{name: rows[:num_worlds] for name, rows in start.items()}) as world:
        sign = np.full((num_worlds, 1), others)
        sign[0] = 1.0
        row, column = np.indices(idle(world).shape)
        for i in range(40):
            world.step(sign * np.sin(0.3 * i + row + 0.7 * column), 1)
        return world.state()


@check("C9")
def threads_change_nothing(backend: Backend) -> list[Finding]:
    """A backend that steps worlds in threads gives the same bits with one thread and with two."""
    if not backend.capabilities.threads:
        return [count("the backend promises no threads; threads that differ", 0)]
    scene, start = robot_scene(tree(damping=0.1), gravity=EARTH), moving_tree(8)
    states = []
    for threads in (1, 2):
        world = backend.build(scene, 8, threads)
        try:
            world.reset(np.ones(8, bool), rest_start(scene, 8, **start))
            swing(world, 20)
            states.append(world.state())
        finally:
            world.close()
    return [count("arrays that differ", differing(states[0], states[1]))]
