"""`guard conform`: check a backend against the contract, clause by clause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from guard_api import plugins
from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.testing.conformance import CheckResult, ConformanceReport, run_conformance


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which backend and which clauses."""

    backend: str
    """Backend to check (`guard list backends`)."""
    clause: tuple[str, ...] = ()
    """Clauses to check, such as C3 C12; all when left out."""
    json: bool = False
    """Print JSON, with every measurement, instead of a table."""


def main(argv: Sequence[str]) -> int:
    """Run the command; exit code 1 when a check failed that is not a declared gap."""
    options = parse(Options, "conform", argv, "Check a backend against the contract, clause by clause.")
    report = run_conformance(plugins.load("guard.backends", options.backend), options.clause or None)
    if options.json:
        print_json(report.to_dict())
    else:
        _print(report)
    return 0 if report.passed else 1


def _print(report: ConformanceReport) -> None:
    versions = ", ".join(f"{package} {version}" for package, version in report.versions.items())
    rows = [(r.clause, r.title, r.status, *_measurement(r), r.reason or "") for r in report.results]
    print_table(f"{report.backend} ({versions})", ("clause", "check", "status", "worst", "tolerance", "why"), rows)
    failed = sum(not result.passed for result in report.results)
    gaps = sum(result.status == "gap" for result in report.results)
    print(f"{len(report.results)} checks: {failed} failed, {gaps} declared gaps")


def _measurement(result: CheckResult) -> tuple[str, str]:
    worst = result.worst
    if worst is None:
        return "", ""
    return f"{worst.value:.2g} {worst.unit}".strip(), f"{worst.tolerance:.2g}"
