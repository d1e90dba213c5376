"""Scenes that the tests of worlds share."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from guard_api.physics.backend import World
from guard_api.physics.state import State
from guard_api.scene.spec import BodyGroup, BodySpec, SceneSpec
from guard_api.scene.start import home_start, place_robot
from guard_api.shapes import Box, Sphere
from guard_api.testing import robots

BOX = BodySpec(shape=Box(half_extents=(0.1, 0.2, 0.3)), physics="dynamic", mass=2.0, height=1.0)
GREMLIN = BodySpec(shape=Sphere(radius=0.1), physics="driven", height=0.1)


def busy_scene() -> SceneSpec:
    """A floating tree with two tumbling boxes and three driven balls: everything that `ideal` simulates."""
    groups = (BodyGroup(name="boxes", body=BOX, count=2), BodyGroup(name="gremlins", body=GREMLIN, count=3))
    return SceneSpec(robot=robots.floating_tree(), groups=groups)


def begin(world: World) -> None:
    """Start every world differently; world i the same way whatever the number of worlds."""
    n = world.num_worlds
    start = home_start(world.scene, n)
    if world.scene.robot:
        start = place_robot(
            world.scene.robot, start, np.array([[0.1, 0.2]]) * np.arange(n)[:, None], 0.3 * np.arange(n)
        )
    start.body_angular_velocity[:, :2] = np.array([1.0, 2.0, 3.0]) + 0.1 * np.arange(n)[:, None, None]
    world.reset(np.ones(n, bool), start)


def run(world: World, steps: int) -> State:
    """Step with controls, and gremlins on circles, that depend on world and time only."""
    n = world.num_worlds
    phase = np.arange(n)[:, None]
    robot = world.scene.robot
    columns = np.arange(len(robot.actuators) if robot else 0)
    for _ in range(steps):
        time = world.state().time[:, None]
        angle = time + phase + np.arange(3)
        position = np.stack([np.cos(angle), np.sin(angle), np.full_like(angle, 0.1)], axis=-1)
        half = np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], axis=-1)
        world.drive("gremlins", position, half)
        world.step(np.sin(3.0 * time + phase + columns), 5)
    return world.state()


def bits(state: State, worlds: slice = slice(None)) -> dict[str, bytes]:
    return {item.name: getattr(state, item.name)[worlds].tobytes() for item in fields(State)}
