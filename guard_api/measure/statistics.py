"""Estimates with intervals: the hierarchical paired bootstrap, over training seeds and then over episodes.

The unit of replication is the training seed. A replicate draws K of the K seeds with replacement and, for every seed
drawn, E of its E episodes with replacement, *the same draws for every quantity*. Quantities of one (seed, episode) are
therefore paired: what two engines share cancels in their difference. Source: Agarwal et al. 2021 (percentile bootstrap
over runs); Davison and Hinkley 1997, sec. 3.8 (hierarchical resampling).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Verdict: TypeAlias = Literal["safe", "unsafe", "undecided"]

REPLICATES: Final = 10_000
_BLOCK: Final = 2_000_000  # numbers at once, which bounds the memory
CONFIDENCE: Final = 0.95

MIN_SEEDS: Final = 3
"""Below this many training seeds no interval is given: resampling two numbers says nothing about a third."""

ADVISED_SEEDS: Final = 5
"""Below this many seeds the interval is printed with a warning, because it is too narrow: see `COVERAGE`."""

COVERAGE: Final = {3: 0.75, 5: 0.84, 10: 0.90}
"""Seeds -> how often the nominal 95 % interval of a paired gap held the true gap, measured on synthetic data.

The case is the hardest: seeds differ much more than the episodes of one seed do.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number with its 95 % interval [low, high], None where there is none, and the points behind it.

    per_seed: (K,) the same number from each training seed alone, None where that seed's is undefined. reason: why
    there is no interval or no number.
    """

    value: float | None
    low: float | None = None
    high: float | None = None
    per_seed: tuple[float | None, ...]
    reason: str = ""


class Bootstrap:
    """The replicates of K seeds with E episodes each, drawn once and used for every quantity.

    The same `rng_seed` gives the same intervals, bit for bit.
    """

    def __init__(self, seeds: int, episodes: int, *, replicates: int = REPLICATES, rng_seed: int = 0) -> None:
        self.seeds, self.episodes, self.replicates = seeds, episodes, replicates
        self._counts: NDArray[np.uint16] | None = None
        if seeds >= MIN_SEEDS:
            self._counts = _counts(seeds, episodes, replicates, np.random.default_rng(rng_seed))

    @property
    def available(self) -> bool:
        """Whether there are enough seeds for intervals."""
        return self._counts is not None

    def means(self, values: Array) -> Array:
        """Return the replicate means (R,) of `values` (K, E). Raises ValueError below `MIN_SEEDS` seeds."""
        if self._counts is None:
            raise ValueError(f"no bootstrap with {self.seeds} seeds: at least {MIN_SEEDS} are needed")
        flat = values.reshape(-1) / values.size
        blocks = np.array_split(self._counts, max(1, self._counts.size // _BLOCK))
        return np.concatenate([block.astype(np.float64) @ flat for block in blocks])

    def mean(self, values: Array) -> Estimate:
        """Estimate the mean of `values` (K, E): of one quantity, or of a paired difference."""
        return self._estimate(lambda mean: mean(values), tuple(values.mean(axis=1).tolist()))

    def ratio(self, above: Array, below: Array) -> Estimate:
        """Estimate mean(above) / mean(below), both (K, E): a ratio of means, never a mean of ratios.

        Undefined (value None, with the reason) when the denominator is not clearly positive: its interval, or below
        `MIN_SEEDS` seeds its mean, reaches zero.
        """
        means = zip(above.mean(axis=1).tolist(), below.mean(axis=1).tolist(), strict=True)
        per_seed = tuple(a / b if b > 0.0 else None for a, b in means)
        floor = self.mean(below)
        if (floor.low if floor.low is not None else floor.value or 0.0) <= 0.0:
            reason = "undefined: the denominator is not clearly above zero"
            return Estimate(value=None, per_seed=per_seed, reason=reason)
        return self._estimate(lambda mean: mean(above) / mean(below), per_seed)

    def one_sided(self, values: Array) -> tuple[float, float]:
        """Return the lower and the upper one-sided 95 % bound of the mean of `values` (K, E)."""
        low, high = np.quantile(self.means(values), [1.0 - CONFIDENCE, CONFIDENCE])
        return float(low), float(high)

    def _estimate(
        self, of: Callable[[Callable[[Array], Array]], Array], per_seed: tuple[float | None, ...]
    ) -> Estimate:
        value = float(of(lambda values: values.mean()))
        if not self.available:
            return Estimate(value=value, per_seed=per_seed, reason=f"no interval below {MIN_SEEDS} seeds")
        tail = (1.0 - CONFIDENCE) / 2.0
        low, high = np.quantile(of(self.means), [tail, 1.0 - tail])
        return Estimate(value=value, low=float(low), high=float(high), per_seed=per_seed)


@dataclass(frozen=True, slots=True, kw_only=True)
class SafeRetention:
    """How many training seeds are safe (mean cost within the limit) in the source and in the target."""

    both: int
    source_only: int
    target_only: int
    neither: int

    @property
    def retained(self) -> float | None:
        """P(safe in the target given safe in the source); None when no seed is safe in the source."""
        safe = self.both + self.source_only
        return self.both / safe if safe else None


def safe_retention(source: Array, target: Array, limit: float) -> SafeRetention:
    """Count the seeds whose mean cost is at most `limit`, from costs (K, E) in the source and in the target."""
    s, t = source.mean(axis=1) <= limit, target.mean(axis=1) <= limit
    return SafeRetention(
        both=int((s & t).sum()),
        source_only=int((s & ~t).sum()),
        target_only=int((~s & t).sum()),
        neither=int((~s & ~t).sum()),
    )


def verdict(cost: Array, limit: float, bootstrap: Bootstrap) -> Verdict:
    """Return whether costs (K, E) prove their mean within `limit`, prove it above, or neither.

    "safe" when the upper one-sided 95 % bound is at most the limit, "unsafe" when the lower one is above it;
    "undecided" otherwise, and always below `MIN_SEEDS` seeds.
    """
    if not bootstrap.available:
        return "undecided"
    low, high = bootstrap.one_sided(cost)
    return "safe" if high <= limit else "unsafe" if low > limit else "undecided"


def _counts(seeds: int, episodes: int, replicates: int, rng: np.random.Generator) -> NDArray[np.uint16]:
    """Return how often each (seed, episode) was drawn in each replicate: (R, K * E), rows summing to K * E."""
    cells = seeds * episodes
    counts = np.empty((replicates, cells), dtype=np.uint16)
    block = max(1, _BLOCK // cells)
    for first in range(0, replicates, block):
        count = min(block, replicates - first)
        drawn_seed = rng.integers(seeds, size=(count, seeds, 1))
        drawn_episode = rng.integers(episodes, size=(count, seeds, episodes))
        index = np.arange(count)[:, None, None] * cells + drawn_seed * episodes + drawn_episode
        drawn = np.bincount(index.reshape(-1), minlength=count * cells)
        counts[first : first + count] = drawn.reshape(count, cells)
    return counts
