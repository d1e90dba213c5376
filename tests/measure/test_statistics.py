"""Intervals: exact where they must be, symmetric, and as wide as measured."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from guard_api.measure.statistics import COVERAGE, Bootstrap, safe_retention, verdict

RNG_SEED = 11


def paired(seeds: int, episodes: int, shift: float, rng: np.random.Generator):
    """Two engines that share seeds and episodes; the target is higher by `shift` on average."""
    seed_effect = rng.normal(0.0, 1.0, (seeds, 1))
    source = 10.0 + seed_effect + rng.normal(0.0, 2.0, (seeds, episodes))
    gap = shift + rng.normal(0.0, 0.3, (seeds, 1)) + rng.normal(0.0, 0.3, (seeds, episodes))
    return source, source + gap


def test_identical_engines_have_a_gap_of_exactly_zero():
    source, _ = paired(5, 30, 0.0, np.random.default_rng(0))
    gap = Bootstrap(5, 30).mean(source - source)
    assert (gap.value, gap.low, gap.high) == (0.0, 0.0, 0.0)


def test_identical_engines_retain_exactly_all():
    source, _ = paired(5, 30, 0.0, np.random.default_rng(0))
    ratio = Bootstrap(5, 30).ratio(source, source)
    assert (ratio.value, ratio.low, ratio.high) == (1.0, 1.0, 1.0)


def test_a_known_shift_is_recovered_and_pairing_narrows_the_interval():
    source, target = paired(10, 50, 1.5, np.random.default_rng(1))
    bootstrap = Bootstrap(10, 50)
    gap = bootstrap.mean(target - source)
    assert gap.low is not None and gap.high is not None and gap.value is not None
    assert gap.low < 1.5 < gap.high
    assert abs(gap.value - 1.5) < 0.3
    alone = bootstrap.mean(target)
    assert alone.low is not None and alone.high is not None
    assert gap.high - gap.low < (alone.high - alone.low) / 2


def test_swapping_the_labels_mirrors_the_gap():
    source, target = paired(6, 20, 0.4, np.random.default_rng(2))
    bootstrap = Bootstrap(6, 20)
    there, back = bootstrap.mean(target - source), bootstrap.mean(source - target)
    np.testing.assert_allclose([there.value, there.low, there.high], [-x for x in (back.value, back.high, back.low)])


def test_a_constant_factor_scales_the_interval_and_leaves_the_ratio():
    source, target = paired(6, 20, 0.4, np.random.default_rng(3))
    bootstrap = Bootstrap(6, 20)
    a, b = bootstrap.mean(target), bootstrap.mean(8.0 * target)
    np.testing.assert_allclose([b.value, b.low, b.high], [8.0 * x for x in (a.value, a.low, a.high)])
    a, b = bootstrap.ratio(target, source), bootstrap.ratio(8.0 * target, 8.0 * source)
    np.testing.assert_allclose([b.value, b.low, b.high], [a.value, a.low, a.high])


def test_the_replicates_match_a_loop_that_resamples_by_hand():
    values = np.random.default_rng(4).normal(size=(4, 7))
    rng, means = np.random.default_rng(5), []
    for _ in range(20_000):
        seeds = rng.integers(4, size=4)
        means.append(np.mean([values[s, rng.integers(7, size=7)] for s in seeds]))
    fast = Bootstrap(4, 7, replicates=20_000).means(values)
    np.testing.assert_allclose(
        np.quantile(fast, [0.025, 0.5, 0.975]), np.quantile(means, [0.025, 0.5, 0.975]), atol=0.02
    )
    assert abs(fast.std() - np.std(means)) < 0.01


def test_the_ratio_is_one_of_means():
    above, below = np.array([[1.0, 1.0]] * 3), np.array([[1.0, 3.0]] * 3)
    assert Bootstrap(3, 2).ratio(above, below).value == 0.5  # a mean of ratios would be 2/3


def test_a_ratio_over_what_may_be_zero_is_undefined():
    rng = np.random.default_rng(6)
    for seeds in (2, 5):
        ratio = Bootstrap(seeds, 20).ratio(np.ones((seeds, 20)), rng.normal(-0.5, 1.0, (seeds, 20)))
        assert ratio.value is None
        assert "undefined" in ratio.reason
        assert len(ratio.per_seed) == seeds


def test_a_seed_whose_own_ratio_is_undefined_keeps_its_place():
    below = np.array([[4.0, 4.0], [-0.1, 0.0], [2.0, 2.0]])
    for seeds in (2, 3):
        ratio = Bootstrap(seeds, 2).ratio(np.ones((seeds, 2)), below[:seeds])
        assert ratio.per_seed == (0.25, None, 0.5)[:seeds]


@pytest.mark.parametrize("seeds", [1, 2])
def test_too_few_seeds_give_points_and_no_interval(seeds: int):
    values = np.arange(seeds * 4, dtype=float).reshape(seeds, 4)
    bootstrap = Bootstrap(seeds, 4)
    estimate = bootstrap.mean(values)
    assert estimate.low is None and estimate.high is None
    assert "below 3 seeds" in estimate.reason
    assert estimate.per_seed == tuple(values.mean(axis=1))
    assert verdict(values - 1000.0, 0.0, bootstrap) == "undecided"
    with pytest.raises(ValueError, match="at least 3"):
        bootstrap.means(values)


def test_the_same_data_give_the_same_bits():
    values = np.random.default_rng(7).normal(size=(5, 9))
    assert Bootstrap(5, 9).mean(values) == Bootstrap(5, 9).mean(values)


def test_the_verdict_has_three_values():
    cost = np.random.default_rng(8).normal(25.0, 2.0, (6, 40))
    bootstrap = Bootstrap(6, 40)
    assert verdict(cost, 30.0, bootstrap) == "safe"
    assert verdict(cost, 20.0, bootstrap) == "unsafe"
    assert verdict(cost, float(cost.mean()) + 0.01, bootstrap) == "undecided"
    assert verdict(np.zeros((6, 40)), 0.0, bootstrap) == "safe"


def test_safe_retention_counts_seeds():
    source = np.array([[1.0], [1.0], [1.0], [9.0], [9.0]])
    target = np.array([[1.0], [5.0], [9.0], [1.0], [9.0]])
    counts = safe_retention(source, target, limit=5.0)
    assert (counts.both, counts.source_only, counts.target_only, counts.neither) == (2, 1, 1, 1)
    assert counts.retained == 2 / 3
    assert safe_retention(source + 10, target, limit=5.0).retained is None


def coverage(seeds: int, trials: int) -> int:
    """Count intervals that hold the true gap, in the hardest case: seeds differ much more than episodes do."""
    rng, hits = np.random.default_rng(RNG_SEED), 0
    for trial in range(trials):
        gap = 2.0 + rng.normal(0.0, 1.0, (seeds, 1)) + rng.normal(0.0, 0.5, (seeds, 20))
        estimate = Bootstrap(seeds, 20, replicates=1000, rng_seed=trial).mean(gap)
        hits += estimate.low <= 2.0 <= estimate.high
    return hits


def agrees(hits: int, trials: int, claimed: float) -> bool:
    """Whether the claimed coverage, give or take a percent, gives counts as extreme at least once in 10,000 times."""
    return bool(binom.ppf(5e-5, trials, claimed - 0.01) <= hits <= binom.ppf(1 - 5e-5, trials, claimed + 0.01))


def test_coverage_is_roughly_as_stated():
    assert agrees(coverage(5, 150), 150, COVERAGE[5])


@pytest.mark.slow
@pytest.mark.parametrize("seeds", sorted(COVERAGE))
def test_coverage_is_as_stated(seeds: int):
    assert agrees(coverage(seeds, 4000), 4000, COVERAGE[seeds])
