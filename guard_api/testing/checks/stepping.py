"""C5 and C8: time advances exactly, looking changes nothing, and a reset touches only the worlds it names."""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from dataclasses import fields
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from guard_api.model.robot import Actuator
from guard_api.physics.backend import Backend, World
from guard_api.physics.state import State
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, check, count, error, rounding
from guard_api.testing.scenes import (
    MOTION,
    TIMESTEP,
    bodies_scene,
    body,
    differing,
    idle,
    pusher,
    rest_start,
    robot_scene,
    running,
    tree,
)

Values: TypeAlias = dict[str, ArrayLike]
"""Fields of a `Start`."""

READOUTS = ("joint_effort", "touch", "body_contact")


def untouched(*states: State) -> Finding:
    """Return the finding that the robot touches a body, if there is one, in one of `states`: else a check is empty."""
    missed = states[0].body_contact.size > 0 and not any(state.body_contact.any() for state in states)
    return count("runs without the contact that the check needs", int(missed))


def swing(world: World, steps: int, substeps: int = 1) -> None:
    """Drive every actuator with its own sine for `steps` calls of `substeps`: a tape that depends on nothing."""
    columns = np.arange(idle(world).shape[1])
    for i in range(steps):
        wave = np.sin(0.3 * (i * substeps) + columns)
        world.step(np.broadcast_to(wave, (world.num_worlds, len(columns))), substeps)


def moving_tree(num_worlds: int) -> Values:
    """Return a different start of `tree` for each world, spinning and out of its home pose."""
    rng = np.random.default_rng(3)
    joints = len(tree().joints)
    return {
        "base_position": rng.normal(loc=(0, 0, 3), size=(num_worlds, 3)),
        "base_linear_velocity": rng.normal(size=(num_worlds, 3)),
        "base_angular_velocity": rng.normal(size=(num_worlds, 3)),
        "joint_position": 0.3 * rng.normal(size=(num_worlds, joints)),
        "joint_velocity": rng.normal(size=(num_worlds, joints)),
    }


@check("C5")
def time_advances(backend: Backend) -> list[Finding]:
    """`step(control, k)` advances exactly k timesteps, of the state and of its clock."""
    scene = robot_scene(tree())
    speed = np.array([0.5, -0.25, 1.0])
    with running(backend, scene) as world:
        start = world.state().time[0]
        world.step(idle(world), 7)
        world.step(idle(world), 1)
        clock = world.state().time[0]
    joint = robot_scene(pusher())
    with running(backend, joint, joint_velocity=speed[0]) as world:
        world.step(idle(world), 7)
        travelled = world.state().joint_position[0, 0]
    return [
        error("clock after reset", start, 0.0, 0.0, "s"),
        # The clock is the core's own float64 count on every backend: it may not inherit float32.
        error("clock after 7 + 1 substeps", clock, 8 * TIMESTEP, 1e-12, "s"),
        error("way of a coasting joint", travelled, 7 * TIMESTEP * speed[0], rounding(backend, 0.01, 7), "m"),
    ]


@check("C5")
def substeps_compose(backend: Backend) -> list[Finding]:
    """Ten substeps at once and ten single ones give the same bits."""
    scene = robot_scene(tree(damping=0.1), gravity=(0.0, 0.0, -9.81))
    with running(backend, scene, 2, **moving_tree(2)) as world:
        control = idle(world) + 0.5
        world.step(control, 10)
        at_once = world.state()
    with running(backend, scene, 2, **moving_tree(2)) as world:
        for _ in range(10):
            world.step(control, 1)
        singly = world.state()
    return [count("arrays that differ", differing(at_once, singly, (*MOTION[1:], "joint_effort")))]


@check("C5", contacts=True)
def substeps_compose_in_contact(backend: Backend) -> list[Finding]:
    """Ten substeps at once and ten single ones give the same bits while things touch."""
    scene, start = pushing()
    states = []
    for calls, substeps in ((5, 10), (50, 1)):
        with running(backend, scene, 1, **start) as world:
            for _ in range(calls):
                world.step(idle(world) + 1.0, substeps)
            states.append(world.state())
    return [count("arrays that differ", differing(states[0], states[1], MOTION[1:])), untouched(*states)]


def pushing() -> tuple[SceneSpec, Values]:
    """Return a scene in which a servo soon presses the robot on a box over the floor and keeps it there; its start."""
    servo = Actuator(name="servo", law="position", joint="joint", gear=0.05, offset=0.3, kp=200.0, kd=20.0)
    scene = bodies_scene(("box", body(half=0.5), 1), robot=pusher((servo,)))
    return scene, {"joint_velocity": 0.5, "body_position": (0.602, 0.05, 0.5)}


@check("C5")
def looking_changes_nothing(backend: Backend) -> list[Finding]:
    """Reading the state, taking a snapshot and inspecting leave the coming motion alone, bit for bit."""
    scene = robot_scene(tree(damping=0.1), gravity=(0.0, 0.0, -9.81))
    states = []
    for look in (False, True):
        with running(backend, scene, 2, **moving_tree(2)) as world:
            for _ in range(10):
                swing(world, 1)
                if look:
                    _look(world)
            states.append(world.state())
    return [count("arrays that differ", differing(states[0], states[1]))]


@check("C5", contacts=True)
def looking_changes_nothing_in_contact(backend: Backend) -> list[Finding]:
    """Reading, taking a snapshot and inspecting leave a run with contacts alone, bit for bit."""
    scene, start = pushing()
    states = []
    for look in (False, True):
        with running(backend, scene, 1, **start) as world:
            for _ in range(40):
                world.step(idle(world) + 1.0, 1)
                if look:
                    _look(world)
            states.append(world.state())
    return [count("arrays that differ", differing(states[0], states[1])), untouched(*states)]


def _look(world: World) -> None:
    world.state()
    world.snapshot()
    world.inspect(0)


@check("C5")
def arrays_are_the_callers(backend: Backend) -> list[Finding]:
    """No later call changes a state that was handed out, and writing into one changes no world."""
    with running(backend, robot_scene(tree()), 2, **moving_tree(2)) as world:
        first = world.state()
        kept = {item.name: getattr(first, item.name).copy() for item in fields(State)}
        swing(world, 3)
        before = world.state()
        changed = [name for name, array in kept.items() if array.tobytes() != getattr(first, name).tobytes()]
        scratch = world.state()
        for item in fields(State):
            array = getattr(scratch, item.name)
            if array.flags.writeable:
                array[...] = 0
        return [
            count("arrays changed by later calls", changed),
            count("arrays of the world changed by a caller", differing(before, world.state())),
        ]


@check("C8")
def reset_is_selective(backend: Backend) -> list[Finding]:
    """`reset(mask)` leaves every bit of the other worlds alone, now and in the motion that follows."""
    scene = robot_scene(tree(damping=0.1), gravity=(0.0, 0.0, -9.81))
    return _selective(backend, scene, moving_tree(4))


@check("C8", contacts=True)
def reset_is_selective_in_contact(backend: Backend) -> list[Finding]:
    """`reset(mask)` leaves every bit of worlds in contact alone, now and in the motion that follows."""
    scene, start = pushing()
    return _selective(backend, scene, start)


def _selective(backend: Backend, scene: SceneSpec, start: Values) -> list[Finding]:
    mask = np.array([False, True, False, True])
    with running(backend, scene, 4, **start) as world:
        swing(world, 30)
        before = world.state()
        world.reset(mask, rest_start(scene, 4, **start))
        after = world.state()
        swing(world, 10)
        later = world.state()
    with running(backend, scene, 4, **start) as world:
        swing(world, 30)
        swing(world, 10)
        undisturbed = world.state()
    return [
        count("arrays of other worlds changed by the reset", differing(before, after, worlds=~mask)),
        count("arrays of other worlds changed later", differing(undisturbed, later, worlds=~mask)),
        count("clocks of reset worlds not at 0", int(np.count_nonzero(after.time[mask]))),
        untouched(before, undisturbed),
    ]


@check("C8")
def reset_forgets(backend: Backend) -> list[Finding]:
    """A world reset after a history repeats a fresh world bit for bit."""
    scene = robot_scene(tree(damping=0.1), gravity=(0.0, 0.0, -9.81))
    return _forgets(backend, scene, moving_tree(2))


@check("C8", contacts=True)
def reset_forgets_contacts(backend: Backend) -> list[Finding]:
    """A world reset out of a contact repeats a fresh world bit for bit: nothing is warm-started from before."""
    scene, start = pushing()
    return _forgets(backend, scene, start)


def _forgets(backend: Backend, scene: SceneSpec, start: Values) -> list[Finding]:
    with running(backend, scene, 2, **start) as world:
        fresh = world.state()
        swing(world, 20)
        first = world.state()
        swing(world, 17)
        world.reset(np.ones(2, bool), rest_start(scene, 2, **start))
        again = world.state()
        swing(world, 20)
        second = world.state()
    return [
        count("arrays that differ right after the reset", differing(fresh, again)),
        count("arrays that differ 20 steps later", differing(first, second)),
        untouched(first),
    ]


@check("C8", contacts=True)
def reset_clears_readouts(backend: Backend) -> list[Finding]:
    """After a reset out of a contact, touch, contact flags and efforts are zero and the worlds are ok."""
    scene, start = pushing()
    with running(backend, scene, 1, **start) as world:
        world.step(idle(world) + 1.0, 20)
        touched = world.state()
        world.reset(np.ones(1, bool), rest_start(scene, 1, **start))
        state = world.state()
    return [
        untouched(touched),
        count("readouts not cleared", [name for name in READOUTS if np.any(getattr(state, name))]),
        count("worlds not ok", int(np.count_nonzero(~state.ok))),
    ]
