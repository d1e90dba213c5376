"""How much of an engine's speed is left in the environment: efficiency, memory and the share of resets.

    efficiency = environment steps/s / (raw engine steps/s / substeps)

The raw engine is `World.step_raw`: the same world, with the same actuation law, reading nothing back. Both are timed in
one process in short blocks that take turns. A shared machine changes its speed by a factor of two within seconds, so
every block is compared with the raw one right after it, and the efficiency is the median over all turns.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from guard_api.env import Environment, make_environment
from guard_api.errors import SpecError
from guard_api.spec import EnvSpec

WARM_UP_STEPS: Final = 5
RESETS: Final = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchResult:
    """One measurement of one environment on one backend.

    env_steps_per_second: over all worlds, resets included as often as episodes end. raw_steps_per_second: engine
    timesteps over all worlds; both medians over the blocks. efficiency: see the module; efficiency_quartiles: of the
    turns, which the median lies between. reset_share: share of the time of whole episodes.
    memory_per_world: growth of the resident memory of this process and its children, per world [bytes]; None where
    the system does not tell. blocks: how often each was timed; block_steps: environment steps in each block.
    spread: (largest - smallest) / median of the blocks' environment times: how unsteady the machine was.
    """

    env: str
    backend: str
    num_worlds: int
    workers: int | None
    substeps: int
    env_steps_per_second: float
    raw_steps_per_second: float
    efficiency: float
    efficiency_quartiles: tuple[float, float]
    reset_share: float
    memory_per_world: float | None
    blocks: int
    block_steps: int
    spread: float

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON data."""
        return asdict(self)


def bench(
    env: str | EnvSpec,
    backend: str,
    num_worlds: int = 64,
    workers: int | None = None,
    *,
    blocks: int = 101,
    block_seconds: float = 0.05,
) -> BenchResult:
    """Measure `env` on `backend`, with random actions, in `blocks` pairs of blocks of about `block_seconds`.

    Raises SpecError for fewer than one block.
    """
    if blocks < 1:
        raise SpecError(f"blocks is {blocks}: it must be at least 1")
    before = resident_bytes()
    environment = make_environment(env, backend=backend, num_worlds=num_worlds, workers=workers)
    try:
        steps = _block_steps(environment, block_seconds)
        actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, num_worlds, environment.action_size))
        env_times, raw_times = _take_turns(environment, actions, blocks)
        after = resident_bytes()
        reset_time = float(np.median([_timed(lambda e=e: environment.reset(episode=e)) for e in range(RESETS)]))
    finally:
        environment.close()
    stepping_time = environment.episode_length * float(np.median(env_times)) / steps
    reset_share = reset_time / (stepping_time + reset_time)
    low, median, high = (1.0 - reset_share) * np.percentile(raw_times / env_times, (25.0, 50.0, 75.0))
    return BenchResult(
        env=environment.spec.name,
        backend=backend,
        num_worlds=num_worlds,
        workers=workers,
        substeps=environment.substeps,
        env_steps_per_second=num_worlds * environment.episode_length / (stepping_time + reset_time),
        raw_steps_per_second=num_worlds * environment.substeps * steps / float(np.median(raw_times)),
        efficiency=float(median),
        efficiency_quartiles=(float(low), float(high)),
        reset_share=reset_share,
        memory_per_world=None if before is None or after is None else max(after - before, 0) / num_worlds,
        blocks=blocks,
        block_steps=steps,
        spread=float(np.ptp(env_times) / np.median(env_times)),
    )


def resident_bytes() -> int | None:
    """Return the resident memory of this process and all its descendants [bytes]; None without a /proc."""
    if not Path("/proc/self/statm").exists():
        return None
    parents: dict[int, int] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            stat = _read(folder / "stat")
            if stat:
                parents[int(folder.name)] = int(stat.rpartition(")")[2].split()[1])
    family = {os.getpid()}
    while grown := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= grown
    pages = [_read(Path(f"/proc/{pid}/statm")).split() for pid in family]
    return sum(int(fields[1]) for fields in pages if fields) * os.sysconf("SC_PAGE_SIZE")


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:  # the process ended while we looked
        return ""


def _block_steps(env: Environment, seconds: float) -> int:
    """Return how many steps last about `seconds`, without reaching the end of an episode."""
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (WARM_UP_STEPS, env.num_worlds, env.action_size))
    _step_all(env, actions)
    per_step = _timed(lambda: _step_all(env, actions)) / WARM_UP_STEPS
    return max(1, min(int(seconds / per_step), env.episode_length - 1))


def _take_turns(env: Environment, actions: np.ndarray, blocks: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times of `blocks` blocks of environment steps and of as many of raw steps, taken in turns [s]."""
    env_times, raw_times = np.empty(blocks), np.empty(blocks)
    for block in range(blocks):
        env.reset(episode=block)
        env_times[block] = _timed(lambda: _step_all(env, actions))
        raw_times[block] = _timed(lambda: _step_raw(env, len(actions)))
    return env_times, raw_times


def _step_all(env: Environment, actions: np.ndarray) -> None:
    for action in actions:
        env.step(action)


def _step_raw(env: Environment, steps: int) -> None:
    for _ in range(steps):
        env.world.step_raw(env.substeps)


def _timed(action: Callable[[], Any]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
