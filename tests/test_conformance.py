"""Every installed backend keeps the contract, one line per check; and the report tells gaps from failures."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from guard_api import plugins
from guard_api.errors import BackendError, SpecError
from guard_api.testing.checks import ALL
from guard_api.testing.checks.check import Check, Finding
from guard_api.testing.checks.own_robot import robot_checks
from guard_api.testing.conformance import CLAUSES, find, run_check, run_conformance
from guard_api.testing.ideal.world import IdealBackend
from guard_api.testing.robots import floating_body, floating_tree, planar_point, three_link_arm
from tests.engines import engine


@pytest.fixture(scope="module", params=plugins.names("guard.backends"))
def backend(request):
    return engine(request.param)


@pytest.mark.parametrize("item", ALL, ids=[f"{item.clause}-{item.name}" for item in ALL])
def test_backend_keeps(backend, item):
    result = run_check(backend, item)
    found = [f"{f.what}: {f.value:.3g} > {f.tolerance:.3g} {f.unit}" for f in result.findings if not f.holds]
    if result.status == "gap":
        pytest.xfail(f"declared: {result.reason}")
    assert result.status != "gap passes", (
        f"the declared gap is stale, remove it from capabilities.gaps: {result.reason}"
    )
    assert result.passed, "; ".join(found) or result.reason


def test_every_clause_has_checks_and_every_check_a_promise():
    assert {item.clause for item in ALL} == set(CLAUSES)
    assert len({item.name for item in ALL}) == len(ALL)
    assert all(item.measure.__doc__ for item in ALL)


def ideal(**values):
    backend = IdealBackend()
    backend.capabilities = replace(backend.capabilities, **values)
    return backend


def stub(*findings, error=None):
    def measure(backend):
        if error:
            raise error
        return list(findings)

    return Check(clause="C5", name="stub", measure=measure)


GOOD = Finding(what="good", value=1.0, tolerance=2.0)
BAD = Finding(what="bad", value=3.0, tolerance=2.0)
NAN = Finding(what="nan", value=float("nan"), tolerance=2.0)


@pytest.mark.parametrize(
    ("check", "gaps", "status", "passed"),
    [
        (stub(GOOD), {}, "passed", True),
        (stub(GOOD, BAD), {}, "failed", False),
        (stub(GOOD, NAN), {}, "failed", False),
        (stub(), {}, "failed", False),  # a check that measured nothing shows nothing
        (stub(error=BackendError("no\nsecond line")), {}, "error", False),
        (stub(BAD), {"stub": "cannot"}, "gap", True),
        (stub(BAD), {"C5": "cannot"}, "gap", True),
        (stub(BAD), {"C6": "cannot"}, "failed", False),
        (stub(error=BackendError("no")), {"C5": "cannot"}, "gap", True),
        (stub(GOOD), {"stub": "cannot"}, "gap passes", True),
    ],
)
def test_status_of_a_check(check, gaps, status, passed):
    result = run_check(ideal(gaps=gaps), check)
    assert (result.status, result.passed) == (status, passed)
    assert result.reason is None or "\n" not in result.reason
    if gaps and status.startswith("gap"):
        assert result.reason == "cannot"


def test_the_worst_finding_stands_for_the_check():
    assert run_check(ideal(), stub(GOOD, BAD)).worst == BAD
    assert run_check(ideal(), stub(BAD, NAN)).worst is NAN
    assert run_check(ideal(), stub(error=ValueError())).worst is None


def test_a_gap_that_names_nothing_fails_the_report():
    report = run_conformance(ideal(gaps={"dry_frictoin": "typo"}), ["C1"])
    assert not report.passed
    assert [r.name for r in report.results if r.status == "error"] == ["dry_frictoin"]


def test_a_backend_without_contacts_or_exact_snapshots_says_so_in_the_report():
    report = run_conformance(ideal(exact_snapshot=False), ["C7", "C11"])
    reasons = {r.name: r.reason for r in report.results if r.status.startswith("gap")}
    assert "contacts" in reasons["touch_covers_all_substeps"]
    assert "exact_snapshot" in reasons["restore_repeats"]


def test_report_is_json_and_clauses_select():
    report = run_conformance(ideal(), ["C1"])
    data = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert data["passed"] is True and data["backend"] == "ideal" and data["versions"]["numpy"]
    assert {result["clause"] for result in data["results"]} == {"C1"}
    assert data["results"][0]["findings"][0]["tolerance"] > 0


def test_a_nan_measurement_is_still_json():
    report = replace(run_conformance(ideal(), ["C1"]), results=(run_check(ideal(), stub(NAN)),))
    assert json.loads(json.dumps(report.to_dict(), allow_nan=False))["results"][0]["findings"][0]["value"] == "nan"


def test_unknown_clauses_and_checks_are_refused_with_the_nearest_name():
    with pytest.raises(SpecError, match="C12"):
        run_conformance(ideal(), ["C13"])
    with pytest.raises(SpecError, match="mass_matrix"):
        find("mas_matrix")


@pytest.mark.parametrize("make", [floating_tree, three_link_arm, planar_point, floating_body])
def test_any_robot_is_built_as_its_model(backend, make):
    for item in robot_checks(make()):
        result = run_check(backend, item)
        assert result.passed, (item.name, result.worst, result.reason)


def test_a_report_on_a_robot_names_it():
    report = run_conformance(ideal(), ["C4"], robots=[planar_point()])
    assert "mass_matrix:planar_point" in {result.name for result in report.results}
    assert report.passed
