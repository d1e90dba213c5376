"""Open-loop tapes: the same controls from the same start on any engine, and the motion that they make there.

Nothing is fed back, so two motions differ by their engines alone. World i's tape comes from seed i, whatever the
number of worlds is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from guard_api import plugins, rotations
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import control_of
from guard_api.physics.build import build_world
from guard_api.physics.state import Start, State
from guard_api.scene.spec import ContactPreset, SceneSpec
from guard_api.scene.start import home_start

Array = NDArray[np.float64]
Drive: TypeAlias = Literal["random", "gait"]

SAMPLE_TIME: Final = 0.02
"""A motion is looked at this often [s], or after every timestep where that is longer."""

GAIT_FREQUENCY: Final = 0.5
"""Of the sinusoidal gait [Hz]: ten steps a period for Ant and Swimmer, which act every 0.2 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """T samples of N worlds of a robot with L links and K touch sensors; the first sample is the start.

    time: (T,) [s]. link_position: (T, N, L, 3) [m]. centre: (T, N, 3) [m], of the robot's mass.
    touch: (T, N, K) [N], averaged since the sample before. ok: (T, N), False from a divergence of the physics on.
    """

    time: Array
    link_position: Array
    centre: Array
    touch: Array
    ok: NDArray[np.bool_]


def make_tape(robot: RobotModel, num_worlds: int, duration: float, drive: Drive = "random") -> Array:
    """Return the controls of every environment step that begins within `duration` [s]: (S, N, U), over their ranges.

    random: uniform, new at every step. gait: sines of `GAIT_FREQUENCY` with a phase of its own for each actuator.
    """
    step_time = robot.timestep * robot.substeps
    steps, size = int(np.ceil(duration / step_time - 1e-9)), len(robot.actuators)
    streams = [np.random.default_rng(seed) for seed in range(num_worlds)]
    if drive == "random":
        return control_of(robot)(np.stack([stream.uniform(-1.0, 1.0, (steps, size)) for stream in streams], axis=1))
    phase = np.stack([stream.uniform(0.0, 2.0 * np.pi, size) for stream in streams])
    time = step_time * np.arange(steps)[:, None, None]
    return control_of(robot)(np.sin(2.0 * np.pi * GAIT_FREQUENCY * time + phase))


def play(
    backend: str,
    robot: RobotModel,
    tape: Array,
    *,
    preset: ContactPreset = "rigid",
    perturbation: float = 0.0,
    refine: int = 1,
) -> Motion:
    """Return the motion of `robot` under `tape` (S, N, U), alone on the ground, from home.

    perturbation: by how much each joint's and a floating base's coordinates are moved at the start, up or down at
    random [rad, m]. refine: the engine's timestep is the robot's, divided by this.
    """
    num_worlds = tape.shape[1]
    scene = SceneSpec(robot=robot, timestep=robot.timestep / refine, preset=preset)
    piece = _piece(robot)
    world = build_world(plugins.load("guard.backends", backend), scene, num_worlds)
    try:
        world.reset(np.ones(num_worlds, dtype=bool), _perturbed(home_start(scene, num_worlds), robot, perturbation))
        states = [world.state()]
        for control in tape:
            for _ in range(robot.substeps // piece):
                world.step(control, piece * refine)
                states.append(world.state())
    finally:
        world.close()
    return Motion(
        time=np.linspace(0.0, (len(states) - 1) * piece * robot.timestep, len(states)),
        link_position=np.stack([state.link_position for state in states]),
        centre=np.stack([_centre_of_mass(robot, state) for state in states]),
        touch=np.stack([state.touch for state in states]),
        ok=np.stack([state.ok for state in states]),
    )


def _piece(robot: RobotModel) -> int:
    """Return how many timesteps lie between two samples: a divisor of the substeps."""
    fits = [n for n in range(1, robot.substeps + 1) if robot.substeps % n == 0 and n * robot.timestep <= SAMPLE_TIME]
    return max(fits, default=1)


def _perturbed(start: Start, robot: RobotModel, size: float) -> Start:
    stream = np.random.default_rng(0)
    joint = start.joint_position + size * stream.choice((-1.0, 1.0), start.joint_position.shape)
    base = start.base_position
    if robot.floating:
        base = base + size * stream.choice((-1.0, 1.0), base.shape)
    return replace(start, joint_position=joint, base_position=base)


def _centre_of_mass(robot: RobotModel, state: State) -> Array:
    mass = np.array([link.mass for link in robot.links])
    com = np.array([link.com for link in robot.links])
    centres = state.link_position + rotations.rotate(state.link_quaternion, com)
    return (centres * (mass / mass.sum())[:, None]).sum(axis=1)
