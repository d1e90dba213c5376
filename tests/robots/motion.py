"""Robots driven open loop on any backend, and what is asked of every shipped robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guard_api import plugins, rotations
from guard_api.model.inertia import MassProperties, combined, moved, of_shape
from guard_api.model.robot import Link, RobotModel
from guard_api.physics.state import State
from guard_api.physics.transition import SnapshotReader, Transition
from guard_api.scene.spec import ContactPreset, SceneSpec
from guard_api.scene.start import home_start
from guard_api.sensors.inertial import InertialSensors
from guard_api.sensors.proprioception import Proprioception

Array = NDArray[np.float64]

ENGINES = ("mujoco", "bullet", "sapien")
"""The backends with contacts."""


def drive(
    backend_name: str,
    robot: RobotModel,
    control: ArrayLike | Callable[[int], ArrayLike],
    steps: int,
    *,
    num_worlds: int = 1,
    preset: ContactPreset = "rigid",
    place: Mapping[str, float] | None = None,
) -> list[State]:
    """Return the `steps` + 1 states of environment steps under a constant or a time-dependent control.

    They start from home, with joints at `place` by name.
    """
    backend = plugins.load("guard.backends", backend_name)
    scene = SceneSpec(robot=robot, timestep=robot.timestep, preset=preset)
    start = home_start(scene, num_worlds)
    for name, value in (place or {}).items():
        start.joint_position[:, robot.joint_index(name)] = value
    world = backend.build(scene, num_worlds)
    try:
        world.reset(np.ones(num_worlds, bool), start)
        states = [world.state()]
        for step in range(steps):
            now = control(step) if callable(control) else control
            world.step(np.broadcast_to(now, (num_worlds, len(robot.actuators))).astype(float), robot.substeps)
            states.append(world.state())
        return states
    finally:
        world.close()


def random_controls(robot: RobotModel, num_worlds: int, sigma: float = 0.6) -> Callable[[int], Array]:
    """Return normal controls clipped to +-1, the same in every call with the same arguments."""
    return lambda step: np.clip(
        np.random.default_rng(step).normal(size=(num_worlds, len(robot.actuators))) * sigma, -1.0, 1.0
    )


def diverged(states: list[State], speed: float) -> list[str]:
    """Return what is wrong with the motion: worlds given up, or numbers that are not finite or beyond `speed`."""
    wrong = [] if states[-1].ok.all() else [f"worlds {np.flatnonzero(~states[-1].ok)} were given up"]
    fastest = max(float(np.abs(state.link_linear_velocity).max()) for state in states)
    if not fastest < speed:
        wrong.append(f"a link moves at {fastest:.3g} m/s")
    return wrong


def readings(robot: RobotModel, states: list[State]) -> dict[str, Array]:
    """Return what the robot's sensors read after the last of `states`, sorted as in an observation."""
    rest = {"bodies": {}, "origins": {}, "slices": {}, "steps_since_success": np.zeros(len(states[-1].ok), np.int64)}
    reader = SnapshotReader(robot)
    before, now = (reader.read(state, **rest) for state in states[-2:])
    action = np.zeros((len(states[-1].ok), len(robot.actuators)))
    transition = Transition(previous=before, now=now, action=action, duration=robot.timestep * robot.substeps)
    readings = InertialSensors(robot).read(transition) | Proprioception(robot).read(transition)
    return dict(sorted(readings.items()))


def sizes(robot: RobotModel) -> dict[str, int]:
    """Return the observation's parts that are the robot's, in order, and how many numbers each has."""
    read = readings(robot, drive("ideal", robot, 0.0, 1))
    return {name: value.shape[1] for name, value in read.items()}


def of_geometry(link: Link, density: float) -> MassProperties:
    """Return the mass properties of what a link looks like, filled with `density`; overlaps count for every shape."""
    return combined([moved(of_shape(visual.shape, density), visual.pose) for visual in link.visuals])


def centre_of_mass(robot: RobotModel, state: State) -> Array:
    """Return the centre of mass of the whole robot: (N, 3) [m]."""
    total = np.zeros((len(state.ok), 3))
    for index, link in enumerate(robot.links):
        com = state.link_position[:, index] + rotations.rotate(state.link_quaternion[:, index], np.array(link.com))
        total += link.mass * com
    return total / sum(link.mass for link in robot.links)
