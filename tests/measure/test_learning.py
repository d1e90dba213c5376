"""Training runs side by side: grouping, the paper's three numbers, intervals, curves and the page."""

from __future__ import annotations

import os
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from guard_api.cli.main import run
from guard_api.errors import RunError
from guard_api.measure.learning import read_groups
from guard_api.measure.learning_curves import curve, write_curves
from guard_api.measure.scores import markdown, notes, read_published, score
from guard_api.measure.statistics import Bootstrap
from tests.measure.training_runs import leave_run

PUBLISHED = "task,robot,constraint,algorithm,J_r,M_c,rho_c\nGoal,Point,8Hazards,CPO,25.9157,3.2388,0.0036\n"


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda handle: None)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for seed, last in enumerate((10.0, 20.0, 60.0)):
        leave_run(tmp_path / f"cpo_{seed}", [1.0, 2.0 + seed, last], seed=seed)
    leave_run(tmp_path / "deep" / "trpo", [5.0, 7.0], algorithm="trpo")
    return tmp_path


def test_the_last_epoch_s_means_and_their_interval(folder: Path) -> None:
    cpo, trpo = score(read_groups([folder]), {})
    assert (cpo.algorithm, cpo.seeds, cpo.steps) == ("cpo", [0, 1, 2], 3000)  # threads differ and decide nothing
    assert cpo.scores["J_r"].value == pytest.approx(30.0)
    assert cpo.scores["M_c"].value == pytest.approx(3.0)
    assert cpo.scores["rho_c"].value == pytest.approx(0.003)
    expected = Bootstrap(3, 1).mean(np.array([[10.0], [20.0], [60.0]]))
    assert (cpo.scores["J_r"].low, cpo.scores["J_r"].high) == (expected.low, expected.high)
    assert (trpo.scores["J_r"].value, trpo.scores["J_r"].low) == (7.0, None)
    assert any("No interval below 3 seeds" in note for note in notes([trpo]))
    assert not any("No interval" in note for note in notes([cpo]))


def test_more_epochs_average_return_and_cost_but_never_the_rate_over_all(folder: Path) -> None:
    cpo = score(read_groups([folder]), {}, epochs=2)[0]
    assert cpo.scores["J_r"].value == pytest.approx(np.mean([2, 10, 3, 20, 4, 60]))
    assert cpo.scores["rho_c"].value == pytest.approx(0.003)


def test_seeds_that_went_further_are_read_where_the_shortest_ends(folder: Path) -> None:
    leave_run(folder / "trpo_1", [6.0, 9.0, 100.0], seed=1, algorithm="trpo")
    trpo = score(read_groups([folder]), {})[1]
    assert (trpo.steps, trpo.scores["J_r"].value) == (2000, 8.0)
    assert any("shortest" in note for note in trpo.notes)


def test_other_options_are_another_group_and_say_what_differs(folder: Path) -> None:
    leave_run(folder / "limit", [9.0], config={"cost_limit": 2.0, "threads": 1})
    labels = [group.label for group in read_groups([folder])]
    assert labels == ["cpo (cost_limit=0.0)", "cpo (cost_limit=2.0)", "trpo"]


def test_the_same_seed_twice_and_folders_without_runs_are_refused(folder: Path, tmp_path: Path) -> None:
    assert len(read_groups([folder, folder / "cpo_0"])) == 2  # the same folder named twice is one run
    leave_run(folder / "again", [1.0], seed=1)
    with pytest.raises(RunError, match="same seed 1"):
        read_groups([folder])
    (folder / "empty").mkdir()
    with pytest.raises(RunError, match="no run with a finished epoch"):
        read_groups([folder / "empty"])


def test_a_run_that_is_being_written_is_read_without_touching_it(tmp_path: Path) -> None:
    path = leave_run(tmp_path / "a", [1.0, 2.0])
    log = path / "progress.csv"
    log.write_text(log.read_text() + "3,3000,")
    before = log.read_bytes()
    assert read_groups([path])[0].epochs == 2
    assert log.read_bytes() == before


def test_published_values_stand_beside_ours(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "published.csv"
    file.write_text("# Source: a paper\n" + PUBLISHED)
    cpo, trpo = score(read_groups([folder]), read_published(file))
    assert cpo.published == {"J_r": 25.9157, "M_c": 3.2388, "rho_c": 0.0036}
    assert trpo.published is None
    text = markdown([cpo, trpo])
    assert re.search(r"\| cpo \| mujoco \| 3 \| 0\.003 M \| 30\.00 \[.*\] \| 25\.92 \|", text)
    assert text.count("published") == 3


@pytest.mark.parametrize("text", ["task,robot\nGoal,Point\n", PUBLISHED.replace("3.2388", "x"), ""])
def test_a_file_of_published_results_that_does_not_fit_is_named(tmp_path: Path, text: str) -> None:
    file = tmp_path / "published.csv"
    file.write_text(text)
    with pytest.raises(RunError, match=r"published\.csv"):
        read_published(file)


def test_curves_are_means_over_seeds_with_intervals_from_three_on(folder: Path) -> None:
    cpo, trpo = read_groups([folder])
    drawn = curve(cpo, "return_mean")
    np.testing.assert_array_equal(drawn.steps, [1000, 2000, 3000])
    np.testing.assert_allclose(drawn.mean, [1, 3, 30])
    assert drawn.low is not None
    assert drawn.high is not None
    assert drawn.low[0] == drawn.high[0] == pytest.approx(1)
    assert drawn.low[2] < 30 < drawn.high[2]
    assert curve(trpo, "return_mean").low is None


class Outside(HTMLParser):
    """Collects whatever a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [str(v) for k, v in attrs if k in {"src", "href"} and not str(v).startswith("data:")]


def test_the_page_needs_nothing_outside_itself_and_there_is_a_picture_per_environment(folder: Path) -> None:
    leave_run(folder / "ant", [1.0, 2.0], env="Goal_Ant_8Hazards")
    files = write_curves(read_groups([folder]), folder / "out")
    assert [file.name for file in files] == [
        "curves_Goal_Ant_8Hazards.png", "curves_Goal_Point_8Hazards.png", "curves.html"
    ]  # fmt: skip
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files[:2])
    page = files[-1].read_text()
    reader = Outside()
    reader.feed(page)
    assert not reader.found
    assert page.count("data:image/png") == 2
    assert "No interval below 3 seeds" in page


def test_the_commands(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "published.csv"
    file.write_text(PUBLISHED)
    for extra, word in ([], "cpo"), (["--markdown"], "| cpo |"), (["--json"], '"J_r": 25.9157'):
        assert run(["report", str(folder), "--published", str(file), *extra]) == 0
        assert word in capsys.readouterr().out
    assert run(["plot", str(folder), "--out", str(tmp_path / "pictures")]) == 0
    assert (tmp_path / "pictures" / "curves.html").exists()
    for command in ("report", "plot"):
        assert run([command]) == 2
        assert run([command, "/nonexistent/runs"]) == 2
        assert "/nonexistent/runs" in capsys.readouterr().err
