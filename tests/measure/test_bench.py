"""The bench: consistent figures from any backend. No figure is judged here, machines differ."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from guard_api.errors import SpecError
from guard_api.measure import bench as bench_module
from guard_api.measure.bench import bench, resident_bytes


def test_the_figures_hang_together():
    result = bench("Goal_Point_8Hazards", "ideal", num_worlds=3, workers=1, blocks=2, block_seconds=0.02)
    assert json.loads(json.dumps(result.to_json()))["efficiency"] == result.efficiency
    low, high = result.efficiency_quartiles
    assert 0.0 < low <= result.efficiency <= high
    assert 0.0 < result.reset_share < 1.0
    assert (result.num_worlds, result.blocks) == (3, 2)


def test_efficiency_is_the_mean_of_two_turns_whatever_comes_first(monkeypatch):
    # An environment step takes 4 s after a new action and 2 s later, a raw one 2 s and 1 s: half of the speed is left.
    costs = iter([*[0.05] * 5, 4.0, 1.0, 2.0, 2.0, *[0.0] * 5])
    monkeypatch.setattr(bench_module, "_timed", lambda action, count=1: (action(), next(costs))[1])
    result = bench("Goal_Point_8Hazards", "ideal", num_worlds=2, workers=1, blocks=2, block_seconds=0.01)
    assert result.efficiency == pytest.approx(0.5)


@pytest.mark.parametrize("blocks", [0, 3])
def test_turns_come_in_pairs(blocks):
    with pytest.raises(SpecError, match="even"):
        bench("Goal_Point_8Hazards", "ideal", blocks=blocks)


@pytest.mark.skipif(resident_bytes() is None, reason="this system does not tell a process's memory")
def test_memory_of_children_counts():
    before = resident_bytes()
    code = "x = bytearray(b'1') * 60_000_000; print('ready', flush=True); input()"
    child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert child.stdout is not None
    child.stdout.readline()
    during = resident_bytes()
    child.communicate(b"\n")
    assert before is not None and during is not None
    assert during - before > 60_000_000
