"""C9 and C10: worlds repeat themselves, depend on no other world, and fail alone."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guard_api.conventions import DIVERGED_SPEED
from guard_api.physics.backend import Backend
from guard_api.physics.state import State
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, check, count
from guard_api.testing.checks.stepping import Values, moving_tree, pushing, swing, untouched
from guard_api.testing.scenes import (
    WEIGHTLESS,
    bodies_scene,
    body,
    differing,
    idle,
    loose_link,
    one_joint,
    rest_start,
    robot_scene,
    running,
    tree,
)

EARTH = (0.0, 0.0, -9.81)
_EMPTY = {"gravity": WEIGHTLESS, "ground": False}


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


@check("C10")
def a_nan_stays_alone(backend: Backend) -> list[Finding]:
    """A NaN control ends that world (ok False, and it stays so), raises nothing, and leaves every bit of the others."""
    return _bad_control(backend, np.nan)


@check("C10")
def a_blow_up_stays_alone(backend: Backend) -> list[Finding]:
    """A world whose motion overflows ends (ok False), raises nothing, and leaves every bit of the others."""
    return _bad_control(backend, 1e200)


@check("C10")
def a_runaway_is_noticed(backend: Backend) -> list[Finding]:
    """A world in which anything is faster than DIVERGED_SPEED ends (ok False), one of half that speed goes on."""
    slider, hinge = one_joint(), one_joint("continuous")
    findings = _runaway(backend, robot_scene(slider), "joint_velocity", "a sliding joint")
    findings += _runaway(backend, robot_scene(hinge), "joint_velocity", "a hinge")
    free, ball = robot_scene(loose_link()), bodies_scene(("ball", body(sphere=True), 1), **_EMPTY)
    for kind in ("linear", "angular"):
        findings += _runaway(backend, free, f"base_{kind}_velocity", f"a floating base ({kind})")
        findings += _runaway(backend, ball, f"body_{kind}_velocity", f"a body ({kind})")
    return findings


def _runaway(backend: Backend, scene: SceneSpec, field: str, what: str) -> list[Finding]:
    speeds = DIVERGED_SPEED * np.array([0.0, 5.0, -5.0, 0.5])
    velocity = np.zeros_like(getattr(rest_start(scene, len(speeds)), field))
    velocity[..., 0] = speeds.reshape(-1, *[1] * (velocity.ndim - 2))
    with running(backend, scene, len(speeds), **{field: velocity}) as world:
        world.step(idle(world), 1)
        ok = world.state().ok
    return [
        count(f"runaways of {what} not noticed", int(ok[1:3].sum())),
        count(f"good worlds with {what} called bad", int((~ok[[0, 3]]).sum())),
    ]


def _bad_control(backend: Backend, value: float) -> list[Finding]:
    robot = tree(damping=0.1)
    actuators = tuple(replace(actuator, ctrl_range=(-1e300, 1e300)) for actuator in robot.actuators)
    scene, start = robot_scene(replace(robot, actuators=actuators), gravity=EARTH), moving_tree(3)
    others = np.array([True, False, True])
    with running(backend, scene, 3, **start) as world:
        swing(world, 10)
        expected = world.state()
        for _ in range(10):
            world.step(idle(world), 2)
        undisturbed = world.state()
    with running(backend, scene, 3, **start) as world:
        fresh = world.state()
        swing(world, 10)
        control = idle(world)
        control[1, :] = value
        for _ in range(5):
            world.step(control, 2)
        failed = world.state()
        for _ in range(5):
            world.step(idle(world), 2)
        later = world.state()
        world.reset(~others, rest_start(scene, 3, **start))
        recovered = world.state()
        swing(world, 10)
        again = world.state()
    return [
        count("bad worlds not noticed", int(failed.ok[1])),
        count("bad worlds silently back", int(later.ok[1])),
        count("good worlds called bad", int(np.count_nonzero(~later.ok[others]))),
        count("arrays of other worlds that differ", differing(undisturbed, later, worlds=others)),
        count("arrays that differ right after the reset of a bad world", differing(fresh, recovered, worlds=~others)),
        count("arrays that differ 10 steps after it", differing(expected, again, worlds=~others)),
    ]
