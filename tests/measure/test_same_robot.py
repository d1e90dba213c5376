"""The proof that robots are the same: what the measurements make of motions that are known, and files that survive."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from guard_api import plugins
from guard_api.errors import BackendError, SpecError
from guard_api.measure import cells, endurance
from guard_api.measure.cells import Cell, read_records, run_cells
from guard_api.measure.divergence import compare, measure_divergence, median_time
from guard_api.measure.locomotion import differs, interval, moves_by_contact, summarise
from guard_api.measure.tapes import Motion, make_tape, play
from guard_api.model.library import load_robot, robot_names
from tests.measure.toy_environment import ToyEnvironment


def motion(position: np.ndarray, *, ok: np.ndarray | None = None, touch: np.ndarray | None = None) -> Motion:
    """A robot of one link at `position` (T, N, 3), sampled every 0.1 s."""
    steps, worlds = position.shape[:2]
    return Motion(
        time=0.1 * np.arange(steps),
        link_position=position[:, :, None],
        centre=position,
        touch=np.zeros((steps, worlds, 0)) if touch is None else touch,
        ok=np.ones((steps, worlds), bool) if ok is None else ok,
    )


# --- tapes


def test_a_worlds_tape_depends_on_its_seed_alone():
    robot = load_robot("ant")
    few, many = make_tape(robot, 2, 3.0), make_tape(robot, 5, 3.0)
    np.testing.assert_array_equal(few, many[:, :2])
    assert few.shape == (15, 2, 8)
    assert not np.array_equal(few[:, 0], few[:, 1])
    gait = make_tape(robot, 2, 4.0, "gait")
    np.testing.assert_allclose(gait[:10], gait[10:], atol=1e-12)  # a period of 2 s
    assert np.ptp(gait, axis=0).min() > 1.5


def test_halving_the_timestep_keeps_the_samples_and_converges():
    robot = load_robot("point")
    tape = make_tape(robot, 2, 0.2)
    base, half, fourth = (play("ideal", robot, tape, refine=n) for n in (1, 2, 4))
    np.testing.assert_allclose(base.time, half.time)
    assert base.time[-1] == pytest.approx(0.2)
    coarse, fine = (np.abs(a.centre - b.centre).max() for a, b in ((base, half), (half, fourth)))
    assert 0.0 < fine < coarse < 1e-3


def test_a_perturbation_moves_the_start_by_its_size():
    robot = load_robot("point")
    tape = make_tape(robot, 1, 0.02)
    moved = play("ideal", robot, tape, perturbation=1e-3)
    offset = moved.link_position[0, 0, -1] - play("ideal", robot, tape).link_position[0, 0, -1]
    np.testing.assert_allclose(np.abs(offset), [1e-3, 1e-3, 0.0], atol=1e-12)


# --- divergence


def test_parting_is_the_first_sample_beyond_the_distance():
    still = np.zeros((11, 4, 3))
    leaving = still.copy()
    leaving[:, 0, 0] = 0.004 * np.arange(11)  # beyond 1 cm from the third sample on
    leaving[6:, 1, 2] = np.nan
    leaving[:, 2, 1] = 0.009
    ok = np.ones((11, 4), bool)
    ok[4:, 3] = False
    result = compare(motion(still), motion(leaving, ok=ok), 0.01)
    assert result["parted_after"] == pytest.approx([0.3, 0.6, None, 0.4])
    assert result["gap"]["0.1"] == pytest.approx((0.004 + 0.0) / 2)
    assert result["gap"]["0.5"] == pytest.approx((0.009 + 0.02) / 2)
    assert result["gap"]["1.0"] is None  # two of four are lost
    assert "5.0" not in result["gap"]


def test_the_median_counts_worlds_that_stay_together():
    assert median_time([1.0, 2.0, None]) == 2.0
    assert median_time([1.0, None, None]) is None
    assert median_time([1.0, None]) is None


def test_two_engines_keep_a_contact_free_robot_together():
    names = [name for name in ("ideal", "mujoco") if not plugins.available("guard.backends")[name]]
    if len(names) < 2:
        pytest.skip("mujoco is not installed")
    result = measure_divergence("point", tuple(names), worlds=2, seconds=0.5, distance=0.01)
    assert result["pairs"][0]["parted_after"] == [None, None]
    assert result["pairs"][0]["gap"]["0.1"] < 1e-12  # later Point's chattering servo amplifies rounding
    assert result["pairs"][0]["gap"]["0.5"] < 1e-5
    halved = next(item for item in result["own"] if item["change"] == "timestep")
    assert 1e-6 < halved["gap"]["0.5"] < 1e-2
    assert result["lost"] == dict.fromkeys(names, 0)


@pytest.mark.parametrize("wrong", [{"worlds": 0}, {"seconds": 0.0}, {"distance": float("nan")}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(SpecError, match=next(iter(wrong))):
        measure_divergence("point", ("ideal",), **{"worlds": 1, "seconds": 1.0, "distance": 0.01, **wrong})


# --- locomotion


def test_summary_of_a_known_motion():
    robot = load_robot("ant")
    steps, sensors = 21, len(robot.touch_sensors)
    position = np.zeros((steps, 2, 3))
    position[:, :, 0] = 0.03 * np.arange(steps)[:, None]  # 0.3 m/s
    position[:, :, 2] = 0.2 + 0.5 * np.arange(steps)[:, None]  # rising counts for nothing
    ok = np.ones((steps, 2), bool)
    ok[11:, 1] = False
    position[11:, 1] = 1e30
    touch = np.zeros((steps, 2, sensors))
    touch[1:11, :, 0] = 0.5
    values = summarise(robot, motion(np.repeat(position[:, :, None], len(robot.links), 2)[:, :, 0], ok=ok, touch=touch))
    weight = 9.81 * sum(link.mass for link in robot.links)
    np.testing.assert_allclose(values["speed"], 0.3)
    np.testing.assert_allclose(values["height"], [0.2 + 0.5 * 10.5, 0.2 + 0.5 * 5.5])
    np.testing.assert_allclose(values["contact"], [0.5 / sensors, 1.0 / sensors])
    np.testing.assert_allclose(values["load"], [0.25 / weight, 0.5 / weight], rtol=1e-3)


def test_intervals_are_students_and_differences_are_paired():
    values = [1.0, 2.0, 3.0, 4.0]
    estimate = interval(values)
    assert estimate.mean == 2.5
    assert estimate.half == pytest.approx(3.1824 * 1.29099 / 2.0, rel=1e-4)
    assert interval([1.0]).half == np.inf
    shifted = [1.1, 2.12, 3.09, 4.11]
    assert differs(values, shifted)  # although the two intervals overlap
    assert not differs(values, [2.0, 1.0, 4.0, 3.1])


def test_which_robots_move_by_contact():
    moving = {name for name in robot_names() if moves_by_contact(load_robot(name))}
    assert {"ant", "walker", "swimmer", "car"} <= moving
    assert not moving & {"point", "drone", "arm3", "arm6"}


# --- endurance


def test_every_lost_world_is_counted(monkeypatch: pytest.MonkeyPatch):
    class Toy(ToyEnvironment):
        snapshot = SimpleNamespace(state=SimpleNamespace(link_linear_velocity=np.array([[[3.0, 4.0, 0.0]]])))

    toy = Toy(num_worlds=4, diverge={(0, 0, 3), (2, 1, 5)})
    monkeypatch.setattr(endurance, "make_environment", lambda *_, **__: toy)
    result = endurance.measure_endurance("any", "exact", total_steps=121, num_worlds=4, seed=0)
    assert result["steps"] == 124  # whole steps of all worlds
    assert result["failures"] == {"diverged": 2}
    assert result["episodes"] == 4 + 2
    assert result["fastest"] == 5.0
    assert toy.closed


# --- results that survive


def counted(calls: list[str], name: str, settings: dict | None = None, error: bool = False) -> Cell:
    def measure():
        calls.append(name)
        if error:
            raise BackendError(f"{name} cannot be built")
        return {"number": len(calls)}

    key = {"robot": "point", "backend": name}
    return Cell(key=key, robot="point", backends=("ideal",), settings=settings or {"n": 1}, measure=measure)


def test_finished_cells_survive_an_interruption_and_are_not_measured_again(tmp_path: Path):
    path, calls = tmp_path / "x.json", []

    def interrupted():
        raise KeyboardInterrupt

    stopped = Cell(key={"robot": "point", "backend": "b"}, robot="point", backends=("ideal",), settings={"n": 1},
                   measure=interrupted)  # fmt: skip
    with pytest.raises(KeyboardInterrupt):
        run_cells(path, [counted(calls, "a"), stopped])
    assert [record["backend"] for record in read_records(path)] == ["a"]
    records = run_cells(path, [counted(calls, "a"), counted(calls, "b")])
    assert calls == ["a", "b"]
    assert [record["values"]["number"] for record in records] == [1, 2]
    assert records[0]["manifest"]["versions"]["numpy"] == np.__version__
    assert "point.urdf" in " ".join(records[0]["assets"])


@pytest.mark.parametrize("change", ["settings", "assets", "code", "again", "error"])
def test_a_cell_is_measured_again_when_what_made_it_changed(tmp_path: Path, monkeypatch, change: str):
    path, calls = tmp_path / "x.json", []
    run_cells(path, [counted(calls, "a", error=change == "error"), counted(calls, "b")])
    if change == "assets":
        monkeypatch.setattr(cells, "asset_hashes", lambda robot: {"point.urdf": "other"})
    if change == "code":
        monkeypatch.setattr(cells, "_code_hash", lambda module: "other")
    settings = {"n": 2} if change == "settings" else None
    run_cells(path, [counted(calls, "a", settings)], again=change == "again")
    assert calls == ["a", "b", "a"]
    assert [record["backend"] for record in read_records(path)] == ["a", "b"]


def test_a_refusal_is_recorded_and_costs_no_other_cell(tmp_path: Path):
    calls: list[str] = []
    records = run_cells(tmp_path / "x.json", [counted(calls, "a", error=True), counted(calls, "b")])
    assert records[0]["error"] == "a cannot be built"
    assert records[1]["values"] == {"number": 2}
