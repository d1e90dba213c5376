"""The freest candidate: known cases, and the compiled form against the plain one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guard_api.scene import overlap
from guard_api.scene.overlap import freest

CANDIDATES = np.array([[[0.0, 0.0, 1.0], [0.5, 0.0, 2.0], [3.0, 0.0, 3.0], [9.0, 0.0, 4.0]]])
PLACES = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])


def test_the_first_free_candidate_is_taken() -> None:
    best, least = freest(CANDIDATES, None, PLACES, np.array([0.64, 0.64]))
    assert best.tolist() == [[3.0, 0.0, 3.0]]
    assert least.tolist() == [0.0]


def test_without_a_free_one_the_least_overlap_is_taken() -> None:
    """Reaches of 0.8 m: at the first place 0.64 m^2, between the two 0.39 each; heights do not count."""
    best, least = freest(CANDIDATES[:, :2], None, PLACES, np.array([0.64, 0.64]))
    assert best.tolist() == [[0.0, 0.0, 1.0]]
    assert least == pytest.approx([0.64])
    best, least = freest(CANDIDATES[:, :2], None, PLACES, np.array([0.64, 0.0]))
    assert best.tolist() == [[0.5, 0.0, 2.0]]
    assert least == pytest.approx([0.64 - 0.25])


def test_what_is_not_allowed_is_not_taken() -> None:
    reach = np.array([0.64, 0.64])
    best, least = freest(CANDIDATES, np.array([[True, True, False, True]]), PLACES, reach)
    assert (best[0, 0], least[0]) == (9.0, 0.0)
    assert freest(CANDIDATES, np.zeros((1, 4), dtype=bool), PLACES, reach)[1] == np.inf


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), items=st.integers(1, 12), reach=st.floats(0.1, 1.5), masked=st.booleans())
def test_the_compiled_form_gives_the_same_bits(seed: int, items: int, reach: float, masked: bool) -> None:
    """Not to rounding but exactly: a candidate chosen otherwise would be another layout."""
    pytest.importorskip("numba")
    rng = np.random.default_rng(seed)
    points, places = rng.uniform(-2, 2, (9, 17, 3)), rng.uniform(-2, 2, (9, items, 3))
    allowed = rng.random((9, 17)) < 0.3 if masked else None
    squared_reach = np.where(rng.random(items) < 0.2, 0.0, reach**2)
    one, other = (form(points, allowed, places, squared_reach) for form in (freest, overlap._plainly_freest))
    for values, expected in zip(one, other, strict=True):
        np.testing.assert_array_equal(values, expected)
