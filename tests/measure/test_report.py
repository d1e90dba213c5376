"""Report and matrix: complete, self-contained, honest about few seeds, and made from transfer.json alone."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from guard_api.errors import RunError
from guard_api.measure.report import render, write_report
from guard_api.measure.result import TransferResult, read_result
from guard_api.measure.transfer import run_transfer
from guard_api.measure.wording import caveats, headline, interval_text, number, value_text

PNG = b"\x89PNG\r\n\x1a\n"


class Balanced(HTMLParser):
    """Collects what is referred to, and fails on tags that are not closed in order."""

    VOID = frozenset({"meta", "img", "link", "br", "!doctype"})

    def __init__(self):
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in {"src", "href"} and value]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture
def report(toy, make_plan, tmp_path_factory: pytest.TempPathFactory):
    def make(**changes) -> tuple[Path, str]:
        key = str(changes)
        if key not in _made:
            folder = tmp_path_factory.mktemp("report")
            result = run_transfer(make_plan(**changes), folder / "made")
            assert result is not None
            shutil.copy(result, folder)
            shutil.rmtree(folder / "made")
            _made[key] = folder, write_report(folder).read_text()
        return _made[key]

    return make


_made: dict[str, tuple[Path, str]] = {}
"""Experiment -> folder and report; the folders are not to be changed."""


def test_one_file_that_needs_nothing_else(report):
    folder, html = report()
    parser = Balanced()
    parser.feed(html)
    assert not parser.open
    assert all(reference.startswith("data:") for reference in parser.references)
    assert sum(reference.startswith("data:image/png") for reference in parser.references) == 3
    assert not re.search(r"@import|url\(|<script", html)
    assert (folder / "matrix.png").read_bytes().startswith(PNG)


def test_it_says_the_headline_every_pair_and_every_cell(report):
    folder, html = report()
    result = read_result(folder)
    sentence, detail = headline(result)
    assert sentence in html
    assert detail in html
    # the toy's policies drive 1.3 times as far in the strong engine, and pay for it
    assert re.fullmatch(r"A policy trained in (exact|twin) gains 30\u202f% .* in strong\.", sentence)
    assert "95\u202f% interval [+" in detail
    for transfer in result.transfers:
        for name, gap in transfer["gaps"].items():
            if name in {"return", "cost", "violation", "success"}:
                assert value_text(name, gap, signed=True) in html
    for cell in result.cells:
        assert value_text("cost", cell["estimates"]["cost"]) in html


def test_one_engine_and_two_seeds_make_a_report_that_confesses_it(report):
    _, html = report(backends=("exact",), seeds=(0, 1))
    assert "nothing was transferred" in html
    assert "no interval is given below 3 seeds" in html
    assert "class='interval'" not in html


def test_three_seeds_are_warned_about_with_the_measured_coverage(report):
    folder, html = report()
    assert "75\u202f% of simulated experiments: these are too narrow" in caveats(read_result(folder))[0]
    assert "class='warning'" in html


def test_names_are_escaped(report):
    folder, _ = report()
    data = json.loads((folder / "transfer.json").read_text())
    data["manifest"]["command"] = "guard <script>alert(1)</script>"
    assert "<script" not in render(TransferResult(data))


def test_the_same_result_gives_the_same_bytes(report):
    folder, first = report()
    assert render(read_result(folder)) == first


def test_what_is_no_result_is_refused(tmp_path: Path):
    with pytest.raises(RunError, match="guard transfer"):
        write_report(tmp_path)
    (tmp_path / "transfer.json").write_text('{"format": "other"}')
    with pytest.raises(RunError, match="not a result"):
        write_report(tmp_path)
    (tmp_path / "transfer.json").write_text('{"format": "guard-transfer-1"}')
    with pytest.raises(RunError, match="manifest"):
        write_report(tmp_path)


@pytest.mark.parametrize(
    ("value", "text"),
    [(1234.6, "1,235"), (123.4, "123"), (12.34, "12.3"), (1.234, "1.23"), (0.1234, "0.12"), (0.01234, "0.012"),
     (0.0, "0.00"), (-0.00001, "0.000"), (-5.5, "−5.50")],
)  # fmt: skip
def test_numbers_are_short_and_signed(value: float, text: str):
    assert number(value) == text


def test_an_interval_is_no_finer_than_it_is_wide():
    wide = {"value": 0.02, "low": -7.6543, "high": 8.1234}
    assert interval_text("cost", wide) == "[−7.65, 8.12]"
    assert interval_text("cost", {"value": 3.0, "low": None, "high": None}) == ""
