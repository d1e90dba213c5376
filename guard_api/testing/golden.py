"""Golden trajectories: where open-loop tapes of actions take shipped robots, recorded once per engine.

They notice what no property test does: an engine release, a compiler or a change of ours that moves the numbers a
little. `python -m guard_api.testing.golden --record` records them again, after the reason for the move is understood.

Two runs of one engine version on two processors need not agree to the last bit: maths libraries choose their kernels
(fused multiply-add among them) by the processor. So a recording of the same versions is compared to 1e-12 (float64)
or 1e-5 (float32) relative to the largest component, which a contact-free run of a second keeps on any processor;
one of other versions to 1e-6 or 1e-4, the floor that GUARD promises between *different* engines.

Contact solvers stop at a tolerance of their own, and what is left grows from step to step. Tapes of robots in contact
are short, and their tolerances `CONTACT` times as wide.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guard_api import plugins
from guard_api.errors import GuardError, RunError
from guard_api.model.library import load_robot
from guard_api.physics.backend import Backend
from guard_api.runs.atomic import read_json, write_json
from guard_api.scene.spec import SceneSpec
from guard_api.testing.scenes import running

NUM_WORLDS = 2

FIELDS = ("joint_position", "joint_velocity", "link_position", "link_quaternion", "link_linear_velocity",
          "link_angular_velocity")  # fmt: skip
CONTACT = 1000.0
"""Tolerance of a robot in contact over that of one without."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tape:
    """`steps` random controls for each of `NUM_WORLDS` worlds of `robot`; contact: whether it moves by contacts."""

    robot: str
    steps: int
    contact: bool = False


TAPES = (
    Tape(robot="point", steps=50),
    Tape(robot="arm3", steps=25),
    Tape(robot="drone", steps=10),
    Tape(robot="ant", steps=3, contact=True),
    Tape(robot="hopper", steps=10, contact=True),
)
"""In the order in which they are played."""

REMEDY = "record it with: python -m guard_api.testing.golden --record"

SAME_VERSION = {"float64": 1e-12, "float32": 1e-5}
OTHER_VERSION = {"float64": 1e-6, "float32": 1e-4}


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """How far a run of `robot` is from its recording: the largest `deviation`, relative to each array's largest number.

    moved: package -> (recorded, present) version where they differ. exact: whether every bit is equal.
    """

    robot: str
    deviation: float
    tolerance: float
    exact: bool
    moved: dict[str, tuple[str | None, str | None]]

    @property
    def holds(self) -> bool:
        """Whether the deviation is inside the tolerance; a NaN is not."""
        return self.deviation <= self.tolerance

    def __str__(self) -> str:
        line = f"{self.robot} is {self.deviation:.1e} from the recording, tolerance {self.tolerance:.0e}"
        if not self.moved:
            return line
        moves = ", ".join(f"{name} {was} -> {now}" for name, (was, now) in self.moved.items())
        return f"{line}; versions moved since it was made ({moves}): once the difference is understood, {REMEDY}"


def play(backend: Backend, tape: Tape) -> dict[str, NDArray[np.float64]]:
    """Return the final arrays of `FIELDS` after the tape, from home."""
    robot = load_robot(tape.robot)
    controls = np.random.default_rng(20).uniform(-1.0, 1.0, (tape.steps, NUM_WORLDS, len(robot.actuators)))
    with running(backend, SceneSpec(robot=robot, timestep=robot.timestep), NUM_WORLDS) as world:
        for control in controls:
            world.step(control, robot.substeps)
        state = world.state()
    return {name: getattr(state, name) for name in FIELDS}


def record(backend: Backend, tapes: Sequence[Tape] = TAPES) -> dict[str, Any]:
    """Return the recording of `backend` as JSON data; floats are written in hexadecimal, which loses no bit."""
    recorded = {}
    for tape in tapes:
        arrays = {
            name: {"shape": list(array.shape), "values": [float(value).hex() for value in array.ravel()]}
            for name, array in play(backend, tape).items()
        }
        recorded[tape.robot] = {"steps": tape.steps, "arrays": arrays}
    return {"backend": backend.name, "versions": backend.versions(), "tapes": recorded}


def compare(backend: Backend, recording: dict[str, Any], tape: Tape) -> Comparison:
    """Run `tape` on `backend` and compare it with a recording. Raises RunError for one of another tape."""
    recorded = recording.get("tapes", {}).get(tape.robot, {})
    if recorded.get("steps") != tape.steps:
        raise RunError(f"the recording of {backend.name!r} is of another tape of {tape.robot!r}: {REMEDY}")
    deviations, exact = [0.0], True
    for name, got in play(backend, tape).items():
        stored = recorded["arrays"][name]
        expected = np.array([float.fromhex(value) for value in stored["values"]]).reshape(stored["shape"])
        if got.shape != expected.shape:
            raise RunError(f"{name} of {tape.robot!r}, recorded on {backend.name!r}, is {expected.shape}: {REMEDY}")
        exact = exact and got.tobytes() == expected.tobytes()
        deviations.append(float(np.abs(got - expected).max() / max(1.0, np.abs(expected).max())))
    was, now = recording["versions"], backend.versions()
    moved = {name: (was.get(name), now.get(name)) for name in {*was, *now} if was.get(name) != now.get(name)}
    tolerance = (OTHER_VERSION if moved else SAME_VERSION)[backend.capabilities.precision]
    return Comparison(
        robot=tape.robot,
        deviation=float(np.max(deviations)),  # max() of a list would lose a NaN that is not its first
        tolerance=tolerance * (CONTACT if tape.contact else 1.0),
        exact=exact,
        moved=moved,
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Compare every installed backend with its recording, or record it anew; exit code 1 when one does not hold."""
    parser = argparse.ArgumentParser(prog="python -m guard_api.testing.golden", description=main.__doc__)
    parser.add_argument("--record", action="store_true", help="write the recordings instead of comparing with them")
    parser.add_argument("--backend", nargs="*", help="backends (default: all that are installed)")
    parser.add_argument("--folder", type=Path, default=Path("tests/golden"), help="where the recordings are")
    options = parser.parse_args(argv)
    available = [name for name, problem in plugins.available("guard.backends").items() if problem is None]
    failed = False
    try:
        for name in options.backend or available:
            backend, path = plugins.load("guard.backends", name), options.folder / f"{name}.json"
            if options.record:
                write_json(path, record(backend))
                sys.stdout.write(f"{name}: recorded in {path}\n")
                continue
            recording = read_json(path, REMEDY)
            for comparison in (compare(backend, recording, tape) for tape in TAPES):
                failed = failed or not comparison.holds
                sys.stdout.write(f"{name}: {'' if comparison.holds else 'FAILED: '}{comparison}\n")
    except GuardError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
