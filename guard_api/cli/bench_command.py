"""`guard bench`: steps per second, and how much of the engine's speed is left in the environment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.errors import SpecError
from guard_api.measure.bench import BenchResult, bench

BLOCKS: Final = 250
"""Blocks of environment steps and of raw steps, taken in turns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What to measure, and how long."""

    env: str = "Goal_Point_8Hazards"
    """Environment, or a TOML file that specifies one."""
    backend: str = "mujoco"
    """Simulator."""
    num_worlds: int = 64
    """Worlds stepped together."""
    workers: int | None = None
    """Threads or processes that step the worlds; chosen by GUARD when left out."""
    seconds: float = 10.0
    """About how long to measure."""
    json: bool = False
    """Print JSON instead of a table."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "bench", argv, "Measure the environment's speed against the bare engine's, in one run.")
    if options.seconds <= 0:
        raise SpecError(f"--seconds is {options.seconds}: it must be positive")
    per_block = options.seconds / (2 * BLOCKS)
    result = bench(
        options.env, options.backend, options.num_worlds, options.workers, blocks=BLOCKS, block_seconds=per_block
    )
    if options.json:
        print_json(result.to_json())
    else:
        _print(result)
    return 0


def _print(result: BenchResult) -> None:
    low, high = result.efficiency_quartiles
    memory = "?" if result.memory_per_world is None else f"{result.memory_per_world / 1e6:.2f} MB"
    rows = [
        ("environment steps/s", result.env_steps_per_second),
        (f"raw engine steps/s / {result.substeps}", result.raw_steps_per_second / result.substeps),
        ("efficiency", result.efficiency),
        ("half of the turns between", f"{low:.3f} and {high:.3f}"),
        ("time spent in resets", f"{100 * result.reset_share:.2f} %"),
        ("memory per world", memory),
    ]
    print_table(f"{result.env} on {result.backend}, {result.num_worlds} worlds", ("quantity", "median"), rows)
