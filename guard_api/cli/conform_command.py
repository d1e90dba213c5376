"""`guard conform`: check a backend against the contract, clause by clause, or what it makes of robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from guard_api import plugins
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.errors import SpecError
from guard_api.model.library import load_robot, robot_names
from guard_api.testing.conformance import CheckResult, ConformanceReport, check_robots, run_conformance

ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which backends, which clauses, which robots."""

    backend: str
    """Backend to check (`guard list backends`), or `all` that are installed."""
    clause: tuple[str, ...] = ()
    """Clauses to check, such as C3 C12; all when left out."""
    robot: str | None = None
    """Check what the backend makes of this robot (`guard list robots`, or the path of its file), or of `all`, instead
    of the contract."""
    json: bool = False
    """Print JSON, with every measurement, instead of a table."""


def main(argv: Sequence[str]) -> int:
    """Run the command; exit code 1 when a check failed that is not a declared gap."""
    options = parse(Options, "conform", argv, "Check a backend against the contract, clause by clause.")
    names = installed_backends() if options.backend == ALL else [options.backend]
    backends = [plugins.load("guard.backends", name) for name in names]
    clauses = options.clause or None
    if options.robot is None:
        reports = [run_conformance(backend, clauses) for backend in backends]
    else:
        robots = [load_robot(name) for name in (robot_names() if options.robot == ALL else [options.robot])]
        reports = [check_robots(backend, robots, clauses) for backend in backends]
    if not any(report.results for report in reports):
        raise SpecError(f"--clause {' '.join(options.clause)}: no check of robots belongs to it: use C3, C4, C6 or C12")
    if options.json:
        print_json([report.to_dict() for report in reports] if options.backend == ALL else reports[0].to_dict())
    elif options.robot == ALL:
        _print_robots(reports)
    else:
        for report in reports:
            _print(report)
    return 0 if all(report.passed for report in reports) else 1


def installed_backends() -> list[str]:
    """Return the names of the backends that can be imported here."""
    return [name for name, reason in plugins.available("guard.backends").items() if reason is None]


def _print(report: ConformanceReport) -> None:
    versions = ", ".join(f"{package} {version}" for package, version in report.versions.items())
    rows = [(r.clause, r.title, r.status, *_measurement(r), r.reason or "") for r in report.results]
    print_table(f"{report.backend} ({versions})", ("clause", "check", "status", "worst", "tolerance", "why"), rows)
    failed = sum(not result.passed for result in report.results)
    gaps = sum(result.status == "gap" for result in report.results)
    print(f"{len(report.results)} checks: {failed} failed, {gaps} declared gaps")


def _print_robots(reports: Sequence[ConformanceReport]) -> None:
    """Print a table of robots by backends, then every check that did not simply pass, with its reason."""
    robots = list(dict.fromkeys(result.robot for report in reports for result in report.results if result.robot))
    rows = [
        (robot, *(_verdict([r for r in report.results if r.robot == robot]) for report in reports)) for robot in robots
    ]
    print_table("robots as the backends hold them", ("robot", *(report.backend for report in reports)), rows)
    for report in reports:
        for result in report.results:
            if result.status != "passed":
                measured, tolerance = _measurement(result)
                worst = f" ({result.worst.what}: {measured}, tolerance {tolerance})" if result.worst else ""
                print(f"{report.backend}: {result.name}: {result.status}{worst} {result.reason or ''}".rstrip())


def _verdict(results: Sequence[CheckResult]) -> str:
    failed = sum(not result.passed for result in results)
    if failed:
        return f"{failed} of {len(results)} failed"
    gaps = sum(result.status == "gap" for result in results)
    return f"{len(results) - gaps} passed" + (f", {gaps} gaps" if gaps else "")


def _measurement(result: CheckResult) -> tuple[str, str]:
    worst = result.worst
    if worst is None:
        return "", ""
    return f"{worst.value:.2g} {worst.unit}".strip(), f"{worst.tolerance:.2g}"
