"""What a conformance check is, what it finds, and where its tolerances come from."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guard_api.conventions import GRAVITY
from guard_api.model.robot import RobotModel
from guard_api.physics.backend import Backend


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One measurement: it holds when `value` <= `tolerance` [unit]; a NaN never holds."""

    what: str
    value: float
    tolerance: float
    unit: str = ""

    @property
    def holds(self) -> bool:
        """Whether the measurement is inside its tolerance."""
        return bool(self.value <= self.tolerance)

    @property
    def strain(self) -> float:
        """How far it uses its tolerance: 1 at the tolerance; NaN counts as infinite."""
        if math.isnan(self.value):
            return math.inf
        return self.value / self.tolerance if self.tolerance > 0 else (math.inf if self.value > 0 else 0.0)


Measure: TypeAlias = Callable[[Backend], list[Finding]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One conformance check: `measure` builds what it needs on a backend and returns what it found.

    clause: "C1".."C12". contacts: whether it needs bodies or things that touch. exact_snapshot: whether it is owed only
    by backends that declare that capability.
    """

    clause: str
    name: str
    measure: Measure
    contacts: bool = False
    exact_snapshot: bool = False

    @property
    def title(self) -> str:
        """First sentence of the measure's docstring."""
        return (self.measure.__doc__ or self.name).strip().splitlines()[0]


def check(clause: str, *, contacts: bool = False, exact_snapshot: bool = False) -> Callable[[Measure], Check]:
    """Turn the decorated measure into a `Check` of `clause` with the function's name."""

    def wrap(measure: Measure) -> Check:
        name = getattr(measure, "__name__", "")
        return Check(clause=clause, name=name, measure=measure, contacts=contacts, exact_snapshot=exact_snapshot)

    return wrap


def count(what: str, wrong: list[str] | int) -> Finding:
    """Return the finding that nothing is `wrong`: the number of items must be 0; their names go into `what`."""
    if isinstance(wrong, int):
        return Finding(what=what, value=float(wrong), tolerance=0.0, unit="count")
    return Finding(what=what + (f": {', '.join(wrong)}" if wrong else ""), value=float(len(wrong)), tolerance=0.0,
                   unit="count")  # fmt: skip


def error(what: str, got: ArrayLike, expected: ArrayLike, tolerance: float, unit: str = "") -> Finding:
    """Return the largest absolute difference of two arrays as a finding; a NaN anywhere makes it NaN."""
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    difference = np.abs(got - expected)
    return Finding(what=what, value=float(difference.max()) if difference.size else 0.0, tolerance=tolerance, unit=unit)


def worst(findings: Iterable[Finding]) -> list[Finding]:
    """Return of the measurements of each quantity the one nearest to, or furthest over, its tolerance."""
    kept: dict[str, Finding] = {}
    for finding in findings:
        if finding.what not in kept or finding.strain > kept[finding.what].strain:
            kept[finding.what] = finding
    return list(kept.values())


def rounding(backend: Backend, scale: float = 1.0, steps: int = 1, operations: int = 256) -> float:
    """Return the bound on accumulated rounding: steps x operations x machine epsilon x scale.

    256 operations cover the longest chain of products and sums behind one number of a small robot; error growth over
    steps is at most linear in the velocities of the short motions that use it.
    """
    epsilon = np.finfo(np.float32 if backend.capabilities.precision == "float32" else np.float64).eps
    return float(steps * operations * epsilon * scale)


def moment_of_weights(robot: RobotModel, link_position: NDArray[np.float64]) -> float:
    """Return the summed sizes of all weights' moments about the root [N m]; link_position: (L, 3) of their origins [m].

    What is left where they cancel, in a balanced robot, is rounding of this.
    """
    spread = [
        np.linalg.norm(link.com) + np.sqrt(np.trace(np.array(link.inertia)) / link.mass) if link.mass else 0.0
        for link in robot.links
    ]
    levers = np.linalg.norm(link_position - link_position[:1], axis=-1) + np.array(spread)
    return float(np.linalg.norm(GRAVITY) * np.array([link.mass for link in robot.links]) @ levers)
