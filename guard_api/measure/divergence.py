"""How long the same controls keep a robot in the same place on two engines, beside what an engine does to itself.

A robot in contact is chaotic: any difference grows, be it the last digit of an engine's arithmetic. So the time until
two engines part says little alone. It is compared with the time until one engine parts from itself when the start moves
by `PERTURBATION`, and when its timestep is halved, which is what the choice of the timestep does to the motion.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import SpecError
from guard_api.measure.tapes import Motion, make_tape, play
from guard_api.model.library import load_robot

Array = NDArray[np.float64]

PERTURBATION: Final = 1e-6
"""Change of the start [rad, m]."""

GAP_TIMES: Final = (0.1, 0.5, 1.0, 5.0)
"""When the distance between two motions is reported [s]."""


def measure_divergence(
    robot: str, backends: tuple[str, ...], *, worlds: int, seconds: float, distance: float
) -> dict[str, Any]:
    """Return when the motions of `robot` part on each pair of `backends`, and of each from itself, as JSON data.

    worlds: how many random tapes. distance: that some link's frame must have between two motions [m].
    Raises SpecError for fewer than one world and for a length or distance that is not positive.
    """
    for name, value in (("worlds", worlds), ("seconds", seconds), ("distance", distance)):
        if not value > 0:
            raise SpecError(f"{name} is {value}: it must be positive")
    model = load_robot(robot)
    tape = make_tape(model, worlds, seconds)
    motions = {backend: play(backend, model, tape) for backend in backends}
    pairs, own = [], []
    for a, b in combinations(backends, 2):
        pairs.append({"between": [a, b], **compare(motions[a], motions[b], distance)})
    for backend in backends:
        moved = play(backend, model, tape, perturbation=PERTURBATION)
        finer = play(backend, model, tape, refine=2)
        own.append({"backend": backend, "change": "start", **compare(motions[backend], moved, distance)})
        own.append({"backend": backend, "change": "timestep", **compare(motions[backend], finer, distance)})
    return {"pairs": pairs, "own": own, "lost": {b: int((~motion.ok[-1]).sum()) for b, motion in motions.items()}}


def compare(a: Motion, b: Motion, distance: float) -> dict[str, Any]:
    """Return when two motions part and how far apart they are, as JSON data.

    parted_after: (N,) [s], the first sample at which some link is farther than `distance` from where it is in the other
    motion, or a world was lost; None where they stay together to the end. gap: time -> median over the worlds of the
    farthest link's distance then [m].
    """
    gap = separation(a, b)
    together = gap <= distance  # a NaN has parted
    parted = np.where(np.all(together, axis=0), np.inf, a.time[np.argmin(together, axis=0)])
    rows = {time: int(np.searchsorted(a.time, time - 1e-9)) for time in GAP_TIMES}
    medians = {str(time): float(np.median(gap[row])) for time, row in rows.items() if row < len(gap)}
    return {
        "parted_after": [time if np.isfinite(time) else None for time in parted.tolist()],
        "gap": {time: value if np.isfinite(value) else None for time, value in medians.items()},
    }


def separation(a: Motion, b: Motion) -> Array:
    """Return how far the link that differs most is from its place in the other motion: (T, N) [m]; inf once lost."""
    gap = np.linalg.norm(a.link_position - b.link_position, axis=-1).max(axis=-1)
    return np.where(a.ok & b.ok, gap, np.inf)


def median_time(parted_after: list[float | None]) -> float | None:
    """Return the median over worlds [s]; None where at least half of them stay together to the end."""
    median = float(np.median([np.inf if time is None else time for time in parted_after]))
    return median if np.isfinite(median) else None
