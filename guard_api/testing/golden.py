"""Golden trajectories: where an open-loop tape of actions takes the shipped robot Point, recorded once per engine.

They notice what no property test does: an engine release, a compiler or a change of ours that moves the numbers a
little. `python -m guard_api.testing.golden --record` records them again, after the reason for the move is understood.

Two runs of one engine version on two processors need not agree to the last bit: maths libraries choose their kernels
(fused multiply-add among them) by the processor. So a recording of the same versions is compared to 1e-12 (float64)
or 1e-5 (float32) relative to the largest component, which a contact-free run of a second keeps on any processor;
one of other versions to 1e-6 or 1e-4, the floor that GUARD promises between *different* engines.
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

ROBOT = "point"
NUM_WORLDS = 2
STEPS = 50
FIELDS = ("joint_position", "joint_velocity", "link_position", "link_quaternion", "link_linear_velocity",
          "link_angular_velocity")  # fmt: skip
REMEDY = "record it with: python -m guard_api.testing.golden --record"

SAME_VERSION = {"float64": 1e-12, "float32": 1e-5}
OTHER_VERSION = {"float64": 1e-6, "float32": 1e-4}


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """How far a run is from its recording: the largest `deviation` relative to each array's largest component.

    moved: package -> (recorded, present) version where they differ. exact: whether every bit is equal.
    """

    deviation: float
    tolerance: float
    exact: bool
    moved: dict[str, tuple[str | None, str | None]]

    @property
    def holds(self) -> bool:
        """Whether the deviation is inside the tolerance; a NaN is not."""
        return self.deviation <= self.tolerance

    def __str__(self) -> str:
        line = f"{self.deviation:.1e} from the recording, tolerance {self.tolerance:.0e}"
        if not self.moved:
            return line
        moves = ", ".join(f"{name} {was} -> {now}" for name, (was, now) in self.moved.items())
        return f"{line}; versions moved since it was made ({moves}): once the difference is understood, {REMEDY}"


def play(backend: Backend) -> dict[str, NDArray[np.float64]]:
    """Return the final arrays of `FIELDS` after the tape: Point in `NUM_WORLDS` worlds, `STEPS` controls each."""
    robot = load_robot(ROBOT)
    tape = np.random.default_rng(20).uniform(-1.0, 1.0, (STEPS, NUM_WORLDS, len(robot.actuators)))
    with running(backend, SceneSpec(robot=robot, timestep=robot.timestep), NUM_WORLDS) as world:
        for control in tape:
            world.step(control, robot.substeps)
        state = world.state()
    return {name: getattr(state, name) for name in FIELDS}


def record(backend: Backend) -> dict[str, Any]:
    """Return the recording of `backend` as JSON data; floats are written in hexadecimal, which loses no bit."""
    arrays = {
        name: {"shape": list(array.shape), "values": [float(value).hex() for value in array.ravel()]}
        for name, array in play(backend).items()
    }
    return {"backend": backend.name, "versions": backend.versions(), "robot": ROBOT, "steps": STEPS, "arrays": arrays}


def compare(backend: Backend, recording: dict[str, Any]) -> Comparison:
    """Run the tape on `backend` and compare it with a recording. Raises RunError for one of another tape."""
    if recording.get("robot") != ROBOT or recording.get("steps") != STEPS:
        raise RunError(f"the recording of {backend.name!r} is of another tape: {REMEDY}")
    deviations, exact = [0.0], True
    for name, got in play(backend).items():
        stored = recording["arrays"][name]
        expected = np.array([float.fromhex(value) for value in stored["values"]]).reshape(stored["shape"])
        if got.shape != expected.shape:
            raise RunError(f"{name} in the recording of {backend.name!r} has shape {expected.shape}: {REMEDY}")
        exact = exact and got.tobytes() == expected.tobytes()
        deviations.append(float(np.abs(got - expected).max() / max(1.0, np.abs(expected).max())))
    was, now = recording["versions"], backend.versions()
    moved = {name: (was.get(name), now.get(name)) for name in {*was, *now} if was.get(name) != now.get(name)}
    tolerance = (OTHER_VERSION if moved else SAME_VERSION)[backend.capabilities.precision]
    # max() of a list would lose a NaN that is not its first.
    return Comparison(deviation=float(np.max(deviations)), tolerance=tolerance, exact=exact, moved=moved)


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
                line = f"recorded in {path}"
            else:
                comparison = compare(backend, read_json(path, REMEDY))
                failed = failed or not comparison.holds
                line = ("" if comparison.holds else "FAILED: ") + str(comparison)
            sys.stdout.write(f"{name}: {line}\n")
    except GuardError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
