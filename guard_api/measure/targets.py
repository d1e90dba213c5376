"""GUARD's own figures of its robots, such as rest heights, speeds and forces on feet, measured on any engine.

Source: GUARD's robots, code and MuJoCo as published, run under constant controls. Friction of GUARD's contacts decides
how a wheel slips and how legs creep, so those figures are measured with each engine's native contacts as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from guard_api import plugins, rotations
from guard_api.model.library import load_robot
from guard_api.model.robot import RobotModel
from guard_api.physics.state import State
from guard_api.scene.spec import ContactPreset, SceneSpec
from guard_api.scene.start import home_start

States = Sequence[State]

NEAR: Final = 0.02
"""Relative difference from GUARD's figure up to which it counts as reproduced."""

BODY: Final = "robot"
"""The link that GUARD speaks of, in each of its robots."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A figure of a robot after `steps` environment steps of a constant `control`, alone on the ground.

    guard: what it is in GUARD [unit], known to +- `known_to`. read: makes it of the robot and the states before and
    after every step. place: where joints start, by name, if not from home. why: why it differs, where that is known.
    """

    name: str
    unit: str
    guard: float
    read: Callable[[RobotModel, States], float]
    control: float | tuple[float, ...] = 0.0
    steps: int = 40
    place: Mapping[str, float] = field(default_factory=dict)
    preset: ContactPreset = "rigid"
    known_to: float = 0.0
    why: str = ""

    def reproduced(self, value: float) -> bool:
        """Whether `value` is GUARD's to 2 %, beside what GUARD's is known to."""
        return abs(value - self.guard) <= NEAR * abs(self.guard) + self.known_to


def measure_targets(robot: str, backend: str) -> dict[str, float]:
    """Return every figure of `robot` on `backend`, by name. Raises SpecError for a robot without figures."""
    model = load_robot(robot)
    return {figure.name: figure.read(model, run_figure(figure, model, backend)) for figure in FIGURES[robot]}


def run_figure(figure: Figure, robot: RobotModel, backend: str) -> States:
    """Return the `steps` + 1 states that `figure` is read from."""
    scene = SceneSpec(robot=robot, timestep=robot.timestep, preset=figure.preset)
    start = home_start(scene, 1)
    for name, value in figure.place.items():
        start.joint_position[:, robot.joint_index(name)] = value
    control = np.broadcast_to(figure.control, (1, len(robot.actuators))).astype(float)
    world = plugins.load("guard.backends", backend).build(scene, 1)
    try:
        world.reset(np.ones(1, dtype=bool), start)
        states = [world.state()]
        for _ in range(figure.steps):
            world.step(control, robot.substeps)
            states.append(world.state())
    finally:
        world.close()
    return states


def _path(robot: RobotModel, states: States) -> np.ndarray:
    return np.stack([state.link_position[0, robot.link_index(BODY)] for state in states])


def _height(robot: RobotModel, states: States) -> float:
    return float(_path(robot, states)[-1, 2])


def _mean_height(robot: RobotModel, states: States) -> float:
    return float(_path(robot, states)[len(states) // 2 :, 2].mean())


def _distance(robot: RobotModel, states: States) -> float:
    path = _path(robot, states)[:, :2]
    return float(np.linalg.norm(path[-1] - path[0]))


def _speed(robot: RobotModel, states: States) -> float:
    return float(np.linalg.norm(states[-1].link_linear_velocity[0, robot.link_index(BODY)]))


def _turning(robot: RobotModel, states: States) -> float:
    """Return the yaw rate, averaged over the second half."""
    body = robot.link_index(BODY)
    return float(np.mean([state.link_angular_velocity[0, body, 2] for state in states[len(states) // 2 :]]))


def _tipping(robot: RobotModel, states: States) -> float:
    return float(states[-1].link_angular_velocity[0, robot.link_index(BODY), 1])


def _force(robot: RobotModel, states: States) -> float:
    """Return the mean force on a touch sensor over the last quarter."""
    return float(np.mean([state.touch[0] for state in states[-(len(states) // 4) :]]))


def _ankle(robot: RobotModel, states: States) -> float:
    """Return by how much the ankle that is bent least is bent [deg]."""
    ankles = [robot.joint_index(joint.name) for joint in robot.joints if joint.name.startswith("ankle")]
    return float(np.rad2deg(np.abs(states[-1].joint_position[0, ankles]).min()))


def _joint_speed(robot: RobotModel, states: States) -> float:
    return float(np.abs(states[-1].joint_velocity[0]).max())


def _end_effector(robot: RobotModel, states: States) -> np.ndarray:
    assert robot.reference is not None  # the arms have one
    link = robot.link_index(robot.reference.link)
    at, facing = states[0].link_position[0, link], states[0].link_quaternion[0, link]
    return at + rotations.rotate(facing, np.array(robot.reference.pose.position))


def _reach(robot: RobotModel, states: States) -> float:
    return float(np.linalg.norm(_end_effector(robot, states)[:2]))


def _end_height(robot: RobotModel, states: States) -> float:
    return float(_end_effector(robot, states)[2])


def _in_both_presets(figure: Figure) -> tuple[Figure, Figure]:
    return figure, replace(figure, name=f"{figure.name}, native contacts", preset="native", why="")


def _arm(speed: float, reach: float) -> tuple[Figure, ...]:
    return (
        Figure(name="joint speed per unit action", unit="rad/s", guard=speed, read=_joint_speed, control=1.0, steps=2),
        Figure(name="reach of the end effector", unit="m", guard=reach, read=_reach, steps=0),
        Figure(name="height of the end effector", unit="m", guard=1.8, read=_end_height, steps=0),
    )


FIGURES: Final[Mapping[str, tuple[Figure, ...]]] = {
    "point": (
        Figure(name="speed ahead", unit="m/s", guard=1.5, read=_speed, control=(1.0, 0.0), steps=300),
        Figure(name="way in 6 s", unit="m", guard=8.2, read=_distance, control=(1.0, 0.0), steps=300),
        Figure(name="turning", unit="rad/s", guard=3.0, read=_turning, control=(0.0, 1.0), steps=300),
        Figure(name="height", unit="m", guard=0.1, read=_height),
    ),
    "car": (
        Figure(name="height at rest", unit="m", guard=0.0999, read=_height),
        Figure(name="speed ahead after 8 s", unit="m/s", guard=0.81, read=_speed, control=1.0, steps=200),
        *_in_both_presets(
            Figure(name="turning on the spot", unit="rad/s", guard=1.4, read=_turning, control=(1.0, -1.0), steps=200,
                   known_to=0.05,
                   why="the wheels slip all the while, so it is a matter of the contact model: GUARD's own file turns "
                       "at 1.29 to 1.37 in MuJoCo 4, this robot with native contacts and torsional friction at 1.32")
        ),
        Figure(name="way while turning on the spot", unit="m", guard=0.0, read=_distance, control=(1.0, -1.0),
               steps=200, known_to=0.05),
    ),
    "doggo": (
        *_in_both_presets(Figure(name="height at rest", unit="m", guard=0.1613, read=_height, steps=300,
                                 why="firm friction holds the legs where they first stand")),
        *_in_both_presets(Figure(name="drift in 30 s", unit="m", guard=0.08, read=_distance, steps=300,
                                 known_to=0.005)),
    ),
    "ant": (
        Figure(name="height at rest", unit="m", guard=0.1105, read=_height,
               why="GUARD's contact margin of 1 cm, which other engines lack, lets it hover; with it, 0.1099 here"),
        Figure(name="force on each foot", unit="N", guard=0.0335, read=_force),
        Figure(name="bend of the ankles at rest", unit="deg", guard=30.0, read=_ankle),
    ),
    "walker": (
        Figure(name="height", unit="m", guard=0.43, read=_height),
        Figure(name="drift in 15 s", unit="m", guard=0.0, read=_distance, steps=300, known_to=0.005),
    ),
    "hopper": (
        Figure(name="height", unit="m", guard=1.2, read=_height),
        Figure(name="force on the foot at rest", unit="N", guard=31.0, read=_force),
        Figure(name="drift in 15 s", unit="m", guard=0.0, read=_distance, steps=300, known_to=0.005),
    ),
    "humanoid": (
        Figure(name="height", unit="m", guard=1.28, read=_height),
        Figure(name="force on each foot at rest", unit="N", guard=62.0, read=_force, steps=60, known_to=1.0,
               why="a matter of millimetres by which the legs reach below a fixed height"),
        Figure(name="drift in 9 s", unit="m", guard=0.05, read=_distance, steps=300, known_to=0.01,
               why="GUARD's starts with its feet in the floor, which throws it; started so it drifts 0.08 m here"),
    ),
    "arm3": _arm(0.6, 1.0),
    "arm6": _arm(0.4, 1.5),
    "drone": (
        Figure(name="climb at full thrust, fourth step", unit="m/s", guard=1.98, read=_speed, control=1.0, steps=4),
        Figure(name="height where it hovers at 0.1", unit="m", guard=3.0, read=_mean_height, control=0.1,
               place={"slide_z": 1.9}),
        Figure(name="height after a fall, full thrust downwards", unit="m", guard=0.13, read=_height, control=-1.0),
        Figure(name="tipping on the floor", unit="rad/s", guard=0.37, read=_tipping, control=(-1.0, 0.0, 1.0, 0.0),
               steps=80, known_to=0.005),
    ),
}  # fmt: skip
"""Robot -> its figures; Swimmer's are statistics of random controls, in `guard_api.measure.locomotion`."""
