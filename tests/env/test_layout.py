"""Layouts: keepouts hold, every world has its own stream, the impossible is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guard_api.errors import SpecError
from guard_api.scene.area import Item
from guard_api.scene.layout import LayoutSampler

EXTENTS = (-2.0, -2.0, 2.0, 2.0)


def streams(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in seeds]


def sample(sampler: LayoutSampler, *seeds: int) -> np.ndarray:
    return sampler.sample(streams(*seeds), np.zeros(len(seeds)))


def goal_layout(hazards: int = 8) -> LayoutSampler:
    items = (Item(name="robot", keepout=0.4), Item(name="goal", keepout=0.4))
    return LayoutSampler(items + (Item(name="hazards", keepout=0.4),) * hazards, EXTENTS)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_two_items_are_nearer_than_their_keepouts(seed: int) -> None:
    places = sample(goal_layout(), seed)[0, :, :2]
    gaps = np.linalg.norm(places[:, None] - places[None], axis=-1) + 10 * np.eye(len(places))
    assert gaps.min() >= 0.8
    assert np.abs(places).max() <= 2.0 - 0.4


def test_a_world_does_not_depend_on_its_neighbours() -> None:
    alone = sample(goal_layout(), 7)
    together = sample(goal_layout(), 3, 7, 11)
    np.testing.assert_array_equal(alone[0], together[1])


def test_places_fill_the_area_evenly() -> None:
    places = sample(goal_layout(hazards=0), *range(4000))[:, 0]
    quadrant = np.histogram2d(places[:, 0], places[:, 1], bins=2)[0] / 4000
    np.testing.assert_allclose(quadrant, 0.25, atol=0.03)


def test_an_impossible_crowd_is_refused_at_construction_with_its_numbers() -> None:
    with pytest.raises(SpecError, match=r"62 items .*60 hazards 0.4.* 31.2 m\^2: use fewer objects"):
        goal_layout(hazards=60)


def test_a_keepout_wider_than_the_area_is_refused_at_construction() -> None:
    with pytest.raises(SpecError, match=r"goal keeps 3.0 m free"):
        LayoutSampler([Item(name="goal", keepout=3.0)], EXTENTS)
