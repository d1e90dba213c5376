"""How much of an engine's speed is left in the environment: efficiency, memory and the share of resets.

    efficiency = environment steps/s / (raw engine steps/s / substeps)

The raw engine is `World.step_raw`: the same world, with the same actuation law, reading nothing back. Both are timed in
one process in short blocks that take turns on one course of events. An action is held over a block of each, and costs
the solver most when it is new; so in every other turn the raw block comes first, and the efficiency of two turns is the
geometric mean of theirs. Before each block one step of its kind is not timed, since what the other kind left behind
(stages of the engine that are computed already, or are not) would be credited to it. The median of the turns is robust
on a shared machine, whose speed changes within seconds.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
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
    pairs of turns, which the median lies between. reset_share: share of the time of whole episodes.
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
    blocks: int = 250,
    block_seconds: float = 0.02,
) -> BenchResult:
    """Measure `env` on `backend`, with random actions, in `blocks` turns of two blocks of about `block_seconds`.

    Raises SpecError for an odd number of turns, or none.
    """
    if blocks < 2 or blocks % 2:
        raise SpecError(f"blocks is {blocks}: it must be even, and at least 2")
    before = resident_bytes()
    environment = make_environment(env, backend=backend, num_worlds=num_worlds, workers=workers)
    try:
        steps = _block_steps(environment, block_seconds)
        env_times, raw_times = _take_turns(environment, steps, blocks)
        after = resident_bytes()
        reset_time = float(np.median([_timed(lambda e=e: environment.reset(episode=e)) for e in range(RESETS)]))
    finally:
        environment.close()
    stepping_time = environment.episode_length * float(np.median(env_times)) / steps
    reset_share = reset_time / (stepping_time + reset_time)
    ratios = np.sqrt(np.prod((raw_times / env_times).reshape(-1, 2), axis=1))
    low, median, high = (1.0 - reset_share) * np.percentile(ratios, (25.0, 50.0, 75.0))
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
    """Return how many steps last about `seconds`, so few that an episode holds two turns."""
    actions = _random_actions(env, WARM_UP_STEPS)
    per_step = float(np.median([_timed(lambda a=action: env.step(a)) for action in actions]))  # the first ones are slow
    return max(1, min(int(seconds / per_step), (env.episode_length - 5) // 2))


def _take_turns(env: Environment, steps: int, blocks: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times of `blocks` blocks of environment steps and of as many of raw steps, taken in turns [s]."""
    times = np.empty((2, blocks))
    actions = _random_actions(env, blocks)
    per_episode = max(1, (env.episode_length - 1) // (steps + 2))  # an episode that ends would be a reset in a block
    for turn, action in enumerate(actions):
        if turn % per_episode == 0:
            env.reset(episode=turn)
        env.step(action)  # the raw engine goes on under the last action
        held: Sequence[Callable[[], object]] = (
            lambda action=action: env.step(action),
            lambda: env.world.step_raw(env.substeps),
        )
        for kind in (0, 1) if turn % 2 == 0 else (1, 0):
            held[kind]()
            times[kind, turn] = _timed(held[kind], steps)
    return times[0], times[1]


def _random_actions(env: Environment, count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1.0, 1.0, (count, env.num_worlds, env.action_size))


def _timed(action: Callable[[], object], count: int = 1) -> float:
    start = time.perf_counter()
    for _ in range(count):
        action()
    return time.perf_counter() - start
