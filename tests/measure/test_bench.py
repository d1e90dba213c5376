"""The bench: consistent figures from any backend. No figure is judged here, machines differ."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from guard_api.errors import SpecError
from guard_api.measure.bench import bench, resident_bytes


def test_the_figures_hang_together():
    result = bench("Goal_Point_8Hazards", "ideal", num_worlds=3, workers=1, blocks=2, block_seconds=0.02)
    assert json.loads(json.dumps(result.to_json()))["efficiency"] == result.efficiency
    low, high = result.efficiency_quartiles
    assert 0.0 < low <= result.efficiency <= high
    assert 0.0 < result.reset_share < 1.0
    assert (result.num_worlds, result.blocks) == (3, 2)


def test_one_turn_gives_the_ratio_of_its_two_rates():
    result = bench("Goal_Point_8Hazards", "ideal", num_worlds=3, workers=1, blocks=1, block_seconds=0.02)
    ratio = result.env_steps_per_second * result.substeps / result.raw_steps_per_second
    assert result.efficiency == pytest.approx(ratio) == pytest.approx(result.efficiency_quartiles[0])


def test_no_blocks_is_an_error():
    with pytest.raises(SpecError, match="blocks"):
        bench("Goal_Point_8Hazards", "ideal", blocks=0)


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
