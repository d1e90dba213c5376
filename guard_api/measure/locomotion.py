"""How a robot gets along by its contacts: speed, height and foot contact under controls that are equal on every engine.

Single motions of a robot in contact part soon (`guard_api.measure.divergence`), their statistics should not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from guard_api.conventions import GRAVITY
from guard_api.errors import SpecError
from guard_api.measure.statistics import CONFIDENCE
from guard_api.measure.tapes import Drive, Motion, make_tape, play
from guard_api.model.library import load_robot
from guard_api.model.robot import RobotModel
from guard_api.scene.spec import ContactPreset

Array = NDArray[np.float64]

QUANTITIES: Final = {
    "speed": "mean speed [m/s]",
    "height": "mean height [m]",
    "contact": "share of time with foot contact",
    "load": "mean sum of the touch sensors / weight",
}
"""What is measured -> what it is called."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A mean over seeds with its 95 % interval mean +- half; half is infinite below two seeds."""

    mean: float
    half: float


def moves_by_contact(robot: RobotModel) -> bool:
    """Return whether `robot` gets from place to place by touching the ground."""
    return robot.base != "fixed" and robot.collide_ground


def measure_locomotion(
    robot: str, backend: str, *, preset: ContactPreset, drive: Drive, seeds: int, seconds: float, refine: int = 1
) -> dict[str, Any]:
    """Return the statistics of `robot` on `backend`, one world per seed, as JSON data.

    refine: by what the robot's timestep is divided: what converges with it is the timestep's doing, not the engine's.
    The quantities that the robot has of `QUANTITIES`, name -> one value per seed, and how many worlds were `lost`,
    whose values end with them. Raises SpecError for fewer than one seed, no time, or no timestep.
    """
    for name, value in (("seeds", seeds), ("seconds", seconds), ("refine", refine)):
        if not value > 0:
            raise SpecError(f"{name} is {value}: it must be positive")
    model = load_robot(robot)
    motion = play(backend, model, make_tape(model, seeds, seconds, drive), preset=preset, refine=refine)
    values = {name: column.tolist() for name, column in summarise(model, motion).items()}
    return {**values, "lost": int((~motion.ok[-1]).sum())}


def summarise(robot: RobotModel, motion: Motion) -> dict[str, Array]:
    """Return each quantity that `robot` has: (N,), over the samples for which a world lived.

    speed: of the centre of mass over the ground, from sample to sample. height: of the root link's frame, where the
    base floats. Where it has touch sensors, contact: share of samples with a force on one, averaged over the sensors;
    load: sum of their forces over the robot's weight (a force that two sensors feel counts twice).
    """
    alive = motion.ok[1:]
    moved = np.linalg.norm(np.diff(motion.centre[..., :2], axis=0), axis=-1)
    values = {"speed": _mean(moved / np.diff(motion.time)[:, None], alive)}
    if robot.floating:
        values["height"] = _mean(motion.link_position[1:, :, robot.link_index(robot.root), 2], alive)
    if robot.touch_sensors:
        values["contact"] = _mean((motion.touch[1:] > 0.0).mean(axis=-1), alive)
        weight = -GRAVITY[2] * sum(link.mass for link in robot.links)
        values["load"] = _mean(motion.touch[1:].sum(axis=-1) / weight, alive)
    return values


def interval(values: Sequence[float]) -> Interval:
    """Return the mean of one value per seed with Student's interval, which holds for few seeds too."""
    count = len(values)
    half = np.inf
    if count > 1:
        half = stdtrit(count - 1, (1.0 + CONFIDENCE) / 2.0) * np.std(values, ddof=1) / np.sqrt(count)
    return Interval(mean=float(np.mean(values)), half=float(half))


def differs(values: Sequence[float], others: Sequence[float]) -> bool:
    """Return whether the 95 % interval of the difference, paired by seeds, leaves out zero."""
    difference = interval(np.subtract(values, others).tolist())
    return abs(difference.mean) > difference.half


def _mean(values: Array, alive: NDArray[np.bool_]) -> Array:
    """Return the mean over the samples (T, N) for which `alive`: (N,)."""
    return np.where(alive, values, 0.0).sum(axis=0) / np.maximum(alive.sum(axis=0), 1)
