"""C10: worlds fail alone or all at once, raise nothing, stay failed and come back with a reset; closed ones say so."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from guard_api.conventions import DIVERGED_SPEED
from guard_api.errors import BackendError
from guard_api.physics.backend import Backend, World
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, check, count
from guard_api.testing.checks.isolation import EARTH
from guard_api.testing.checks.stepping import Values, moving_tree, swing
from guard_api.testing.checks.thrust import hovering
from guard_api.testing.scenes import (
    WEIGHTLESS,
    bodies_scene,
    body,
    differing,
    effort_actuator,
    idle,
    loose_link,
    one_joint,
    pusher,
    rest_start,
    robot_scene,
    running,
    tree,
)

_EMPTY = {"gravity": WEIGHTLESS, "ground": False}
_HUGE = (-1e300, 1e300)


@check("C10")
def a_nan_stays_alone(backend: Backend) -> list[Finding]:
    """A NaN control ends that world (ok False, and it stays so), raises nothing, and leaves every bit of the others."""
    return _bad_control(backend, np.nan)


@check("C10")
def an_infinity_stays_alone(backend: Backend) -> list[Finding]:
    """An infinite control is not clipped but ends that world, raises nothing, and leaves every bit of the others."""
    return [*_bad_control(backend, np.inf), *_bad_control(backend, -np.inf)]


@check("C10")
def a_blow_up_stays_alone(backend: Backend) -> list[Finding]:
    """A world whose motion overflows ends (ok False), raises nothing, and leaves every bit of the others."""
    return _bad_control(backend, 1e200, ctrl_range=_HUGE)


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


@check("C10")
def all_may_fail_at_once(backend: Backend) -> list[Finding]:
    """Worlds that all fail in one step raise nothing, stay failed, and a reset brings back the ones it names."""
    slider = pusher((effort_actuator(),))
    crowd = bodies_scene(("box", body(), 1), ("gremlin", body("driven"), 1), robot=slider)
    drone = robot_scene(loose_link(actuators=hovering(ceiling=3.0)), gravity=EARTH)
    places: Values = {"body_position": [(2.0, 0.0, 0.2), (4.0, 0.0, 0.2)]}
    return [
        *_all_fail(backend, robot_scene(tree(damping=0.1), gravity=EARTH), moving_tree(2), "of a floating tree"),
        *_all_fail(backend, robot_scene(tree("planar")), {}, "of a planar tree"),
        *_all_fail(backend, crowd, places, "of a slider among bodies"),
        *_all_fail(backend, drone, {}, "of a drone", too_fast="base_linear_velocity"),
    ]


@check("C10")
def a_closed_world_says_so(backend: Backend) -> list[Finding]:
    """A closed world closes again without a word, and answers everything else with BackendError."""
    scene = robot_scene(tree(damping=0.1))
    with running(backend, scene, 2) as world:
        control, start = idle(world), rest_start(scene, 2)
        blob = world.snapshot()
        world.close()
        world.close()
        calls: dict[str, Callable[[], object]] = {
            "reset": lambda: world.reset(np.ones(2, bool), start),
            "step": lambda: world.step(control, 1),
            "step_raw": lambda: world.step_raw(1),
            "state": world.state,
            "snapshot": world.snapshot,
            "restore": lambda: world.restore(blob),
            "inspect": lambda: world.inspect(0),
        }
        return [count("calls that a closed world does not refuse", [n for n, c in calls.items() if not _refused(c)])]


def _refused(call: Callable[[], object]) -> bool:
    try:
        call()
    except BackendError:
        return True
    return False


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


def _all_fail(
    backend: Backend, scene: SceneSpec, start: Values, what: str, too_fast: str = "joint_velocity"
) -> list[Finding]:
    """Let both of two worlds fail in one step, by speed and by control, and begin again at `start` each time."""
    everyone, first = np.ones(2, bool), np.array([True, False])
    good = rest_start(scene, 2, **start)
    fast = rest_start(scene, 2, **start | {too_fast: 5.0 * DIVERGED_SPEED})
    findings = []
    with running(backend, scene, 2, **start) as world:
        swing(world, 5, 2)
        expected = world.state()
        for begin, value, cause in ((fast, 0.0, "speed"), (good, np.nan, "NaN"), (good, np.inf, "infinity")):
            world.reset(everyone, begin)
            _go(world, idle(world) + value, 1)
            failed = world.state().ok
            _go(world, idle(world), 2)
            later = world.state().ok
            world.reset(first, good)
            _go(world, idle(world), 1)
            one = world.state().ok
            world.reset(everyone, good)
            swing(world, 5, 2)
            again = world.state()
            findings += [
                count(f"worlds {what} whose {cause} is not noticed", int(failed.sum())),
                count(f"worlds {what} silently back after {cause}", int(later.sum())),
                count(f"worlds {what} wrong after {cause} and the reset of one", int((one != first).sum())),
                count(f"worlds {what} not back after {cause} and a reset", int((~again.ok).sum())),
                count(f"arrays {what} that differ after {cause} and a reset", differing(expected, again)),
            ]
    return findings


def _go(world: World, control: NDArray[np.float64], steps: int) -> None:
    """Step and look, with the driven bodies sent where they are."""
    for _ in range(steps):
        state = world.state()
        for group in world.scene.groups:
            if group.body.physics == "driven":
                bodies = world.scene.body_slice(group.name)
                world.drive(group.name, state.body_position[:, bodies], state.body_quaternion[:, bodies])
        world.step(control, 3)


def _bad_control(backend: Backend, value: float, ctrl_range: tuple[float, float] = (-1.0, 1.0)) -> list[Finding]:
    robot = tree(damping=0.1)
    actuators = tuple(replace(actuator, ctrl_range=ctrl_range) for actuator in robot.actuators)
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
