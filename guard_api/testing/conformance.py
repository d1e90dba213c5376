"""Run the conformance checks C1-C12 on a backend; `run_conformance(backend).passed` means that the plugin is done."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, TypeAlias

from guard_api.errors import GuardError, SpecError, unknown_name
from guard_api.model.robot import RobotModel
from guard_api.physics.backend import Backend, Capabilities
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks import ALL
from guard_api.testing.checks.check import Check, Finding
from guard_api.testing.checks.own_robot import OF_ROBOTS, robot_checks

Status: TypeAlias = Literal["passed", "failed", "error", "gap", "gap passes"]

CLAUSES = tuple(f"C{i}" for i in range(1, 13))
"""The clauses of the contract, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """What one check found on one backend.

    status: "passed"; "failed" (a finding outside its tolerance); "error" (the check raised); "gap" (it does not hold,
    and the backend declares why); "gap passes" (it holds although a gap is declared: the declaration is stale).
    findings: every measurement; the `worst` of them, nearest to or furthest over its tolerance, stands for the check.
    reason: why the gap is declared, or the one-line error.
    """

    clause: str
    name: str
    title: str
    status: Status
    findings: tuple[Finding, ...] = ()
    reason: str | None = None

    @property
    def passed(self) -> bool:
        """Whether the check holds or its failure is declared."""
        return self.status in {"passed", "gap", "gap passes"}

    @property
    def robot(self) -> str:
        """The robot whose check this is; empty for those of the suite's own robots."""
        return self.name.partition(":")[2]

    @property
    def worst(self) -> Finding | None:
        """The finding nearest to, or furthest over, its tolerance; None when the check raised before it measured."""
        return max(self.findings, key=lambda finding: finding.strain, default=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConformanceReport:
    """The results of all checks on one backend, and the packages that decided its numbers.

    approximations: robot -> what of it, alone on the ground, this engine does not express exactly, one sentence each.
    """

    backend: str
    versions: Mapping[str, str]
    precision: str
    results: tuple[CheckResult, ...]
    approximations: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every check holds or is a declared gap."""
        return all(result.passed for result in self.results)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain JSON data; numbers that JSON lacks (NaN, infinity) become strings."""
        results = [asdict(result) | {"passed": result.passed} for result in self.results]
        report = {"backend": self.backend, "versions": dict(self.versions), "precision": self.precision,
                  "passed": self.passed, "results": results,
                  "approximations": {robot: list(told) for robot, told in self.approximations.items()}}  # fmt: skip
        return _finite(report)


def run_conformance(
    backend: Backend, clauses: Iterable[str] | None = None, robots: Iterable[RobotModel] = ()
) -> ConformanceReport:
    """Run the checks of `clauses` (all when None) on `backend`, and those of its mechanics on `robots` besides.

    A check that does not hold is a gap when the backend's capabilities declare one for its clause or name. Checks of
    declared gaps run all the same; those that need contacts do not run on a backend without any, and say so.
    Raises SpecError for an unknown clause.
    """
    return _run(backend, [*ALL, *(item for robot in robots for item in robot_checks(robot))], clauses)


def check_robots(
    backend: Backend, robots: Iterable[RobotModel], clauses: Iterable[str] | None = None
) -> ConformanceReport:
    """Run only the checks of `robots` on `backend`: whether what the engine holds is the robot of the model.

    Their results are named `check:robot`; the report says too what the engine only approximates.
    Raises SpecError for an unknown clause.
    """
    robots = tuple(robots)
    report = _run(backend, [item for robot in robots for item in robot_checks(robot)], clauses)
    return replace(report, approximations={robot.name: _approximations(backend, robot) for robot in robots})


def _approximations(backend: Backend, robot: RobotModel) -> tuple[str, ...]:
    """Return what `backend` cannot say exactly of `robot` on the ground, or why it refuses the robot."""
    try:
        world = backend.build(SceneSpec(robot=robot, timestep=robot.timestep), 1)
    except GuardError as error:
        return (f"refused: {error}",)
    try:
        return tuple(world.approximations)
    finally:
        world.close()


def _run(backend: Backend, checks: Iterable[Check], clauses: Iterable[str] | None) -> ConformanceReport:
    wanted = tuple(clauses) if clauses is not None else CLAUSES
    for clause in wanted:
        if clause not in CLAUSES:
            raise unknown_name("conformance clause", clause, CLAUSES)
    results = [run_check(backend, item) for item in checks if item.clause in wanted]
    results += _foreign_gaps(backend.capabilities)
    return ConformanceReport(
        backend=backend.name, versions=backend.versions(), precision=backend.capabilities.precision,
        results=tuple(results),
    )  # fmt: skip


def find(name: str) -> Check:
    """Return the check called `name`. Raises SpecError when there is none."""
    for item in ALL:
        if item.name == name:
            return item
    raise unknown_name("conformance check", name, [item.name for item in ALL])


def run_check(backend: Backend, item: Check) -> CheckResult:
    """Run one check; whatever it raises becomes its result, so that one broken check hides no other."""
    gap = _declared(backend.capabilities, item)
    if item.contacts and not backend.capabilities.contacts:
        return _result(item, "gap", (), "not run: the backend has no contacts (capabilities.contacts is False)")
    try:
        findings = tuple(item.measure(backend))
    except Exception as problem:  # noqa: BLE001 - a plugin may raise anything; the report must name it, not die of it
        line = f"{type(problem).__name__}: {problem}".splitlines()[0]
        return _result(item, "gap" if gap else "error", (), gap or line)
    holds = all(finding.holds for finding in findings) and bool(findings)
    if gap and not (holds and ":" in item.name):  # what an engine cannot do of one robot, it may do of another
        return _result(item, "gap passes" if holds else "gap", findings, gap)
    return _result(item, "passed" if holds else "failed", findings, None)


def _result(item: Check, status: Status, findings: tuple[Finding, ...], reason: str | None) -> CheckResult:
    return CheckResult(
        clause=item.clause, name=item.name, title=item.title, status=status, findings=findings, reason=reason
    )


def _declared(capabilities: Capabilities, item: Check) -> str | None:
    """Return why the backend says that it cannot meet `item`, or None when it promises to."""
    name = item.name.split(":")[0]  # a check of one robot carries its name behind the colon
    reason = capabilities.gaps.get(name) or capabilities.gaps.get(item.clause)
    if reason is None and item.exact_snapshot and not capabilities.exact_snapshot:
        return "a run continued after restore is not bit-identical (capabilities.exact_snapshot is False)"
    return reason


def _foreign_gaps(capabilities: Capabilities) -> list[CheckResult]:
    """Return a failed result for every declared gap that names no clause and no check: a typo must not hide."""
    known = {*CLAUSES, *OF_ROBOTS, *(item.name for item in ALL)}
    return [
        CheckResult(
            clause="gaps", name=name, title="A declared gap names a clause or a check", status="error",
            reason=str(SpecError(f"capabilities.gaps names {name!r}, which is no clause and no check")),
        )
        for name in capabilities.gaps if name not in known
    ]  # fmt: skip


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value
