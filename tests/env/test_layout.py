"""Layouts: keepouts hold, every world has its own stream, the impossible is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guard_api.errors import SpecError
from guard_api.scene.layout import Item, LayoutSampler

EXTENTS = (-2.0, -2.0, 2.0, 2.0)


def streams(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in seeds]


def goal_layout(hazards: int = 8) -> LayoutSampler:
    items = (Item(name="robot", keepout=0.4), Item(name="goal", keepout=0.4))
    return LayoutSampler(items=items + (Item(name="hazards", keepout=0.4),) * hazards, extents=EXTENTS)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_two_items_are_nearer_than_their_keepouts(seed: int) -> None:
    places = goal_layout().sample(streams(seed))[0]
    gaps = np.linalg.norm(places[:, None] - places[None], axis=-1) + 10 * np.eye(len(places))
    assert gaps.min() >= 0.8
    assert np.abs(places).max() <= 2.0 - 0.4


def test_a_world_does_not_depend_on_its_neighbours() -> None:
    alone = goal_layout().sample(streams(7))
    together = goal_layout().sample(streams(3, 7, 11))
    np.testing.assert_array_equal(alone[0], together[1])


def test_places_fill_the_area_evenly() -> None:
    places = goal_layout(hazards=0).sample(streams(*range(4000)))[:, 0]
    quadrant = np.histogram2d(places[:, 0], places[:, 1], bins=2)[0] / 4000
    np.testing.assert_allclose(quadrant, 0.25, atol=0.03)


def test_an_impossible_crowd_is_refused_with_its_numbers() -> None:
    with pytest.raises(SpecError, match=r"62 items .*fewer objects"):
        goal_layout(hazards=60).sample(streams(0))


def test_a_keepout_wider_than_the_area_is_refused_at_construction() -> None:
    with pytest.raises(SpecError, match=r"goal keeps 3.0 m free"):
        LayoutSampler(items=(Item(name="goal", keepout=3.0),), extents=EXTENTS)


def test_replace_moves_one_item_clear_of_the_others() -> None:
    sampler = goal_layout()
    places = sampler.sample(streams(*range(50)))
    moved, found = sampler.replace(1, places, streams(*range(100, 150)))
    assert found.all()
    assert not np.isclose(moved, places[:, 1]).all(axis=1).any()
    others = np.delete(places, 1, axis=1)
    assert np.linalg.norm(moved[:, None] - others, axis=-1).min() >= 0.8


def test_replace_says_when_no_place_is_left() -> None:
    items = (Item(name="goal", keepout=0.4), Item(name="rock", keepout=1.5))
    sampler = LayoutSampler(items=items, extents=(-1.6, -1.6, 1.6, 1.6))
    places = np.zeros((1, 2, 2))
    moved, found = sampler.replace(0, places, streams(0))
    assert not found[0]
    np.testing.assert_array_equal(moved[0], places[0, 0])
