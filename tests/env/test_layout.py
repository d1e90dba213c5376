"""Layouts: all that is asked for holds in every one, worlds have their own streams, the impossible is refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from guard_api.errors import SpecError
from guard_api.model.library import load_robot
from guard_api.scene.area import Item
from guard_api.scene.episode import EpisodeStarter
from guard_api.scene.layout import LayoutSampler
from guard_api.scene.spec import BodyGroup, BodySpec, Placement, SceneSpec
from guard_api.shapes import Sphere

EXTENTS = (-2.0, -2.0, 2.0, 2.0)
TINY = 1e-9

seeds = st.integers(0, 2**32 - 1)


def streams(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in seeds]


def sample(sampler: LayoutSampler, *seeds: int) -> np.ndarray:
    return sampler.sample(streams(*seeds), np.zeros(len(seeds)))


def crowd(*counts: tuple[str, float, int]) -> list[Item]:
    """A robot of keepout 0.4 and `counts` of things (name, keepout, count)."""
    things = [Item(name=name, keepout=keepout) for name, keepout, count in counts for _ in range(count)]
    return [Item(name="robot", keepout=0.4), *things]


def gaps(places: np.ndarray, items: list[Item]) -> np.ndarray:
    """How much further than their keepouts all pairs are from each other: (n, pairs) [m]."""
    i, j = np.triu_indices(len(items), 1)
    keepout = np.array([item.keepout for item in items])
    return np.linalg.norm(places[:, i, :2] - places[:, j, :2], axis=-1) - (keepout[i] + keepout[j])


def group_of(item: Item) -> BodyGroup:
    body = BodySpec(shape=Sphere(radius=0.1), physics="phantom", keepout=item.keepout)
    return BodyGroup(name=item.name, body=body, count=1, placement=item.placement)


@st.composite
def crowds(
    draw: st.DrawFn, things: int = 12, most: float = 0.4
) -> tuple[list[Item], tuple[float, float, float, float]]:
    """Up to so many things that fill up to `most` of an oblong: 0.4 is as crowded as GUARD's suite becomes."""
    width, height = draw(st.floats(2.0, 6.0)), draw(st.floats(2.0, 6.0))
    x, y = draw(st.floats(-9.0, 9.0)), draw(st.floats(-9.0, 9.0))
    keepouts = draw(st.lists(st.floats(0.05, 0.6), min_size=1, max_size=things))
    assume(sum(np.pi * k**2 for k in keepouts) < most * width * height)
    items = [Item(name=f"thing{i}", keepout=keepout) for i, keepout in enumerate(keepouts)]
    return items, (x, y, x + width, y + height)


@given(request=crowds(), seed=seeds)
def test_keepouts_and_extents_hold(request: tuple, seed: int) -> None:
    items, extents = request
    places = sample(LayoutSampler(items, extents), *range(seed, seed + 8))
    assert (gaps(places, items) >= -TINY).all()
    for i, item in enumerate(items):
        assert (places[:, i, :2] >= np.array(extents[:2]) + item.keepout - TINY).all()
        assert (places[:, i, :2] <= np.array(extents[2:]) - item.keepout + TINY).all()


@given(
    least=st.floats(0.0, 1.5),
    width=st.floats(0.5, 1.0),
    heights=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
    slack=st.floats(0.5, 1.0),
    seed=seeds,
)
def test_radius_distance_and_heights_hold(least: float, width: float, heights: tuple, slack: float, seed: int) -> None:
    low, high = heights[0], heights[0] + heights[1]
    distance = float(np.hypot(least, low)) + slack
    placement = Placement(radius=(least, least + width), heights=(low, high), distance=distance)
    items = [Item(name="robot", keepout=0.0), *[Item(name="ball", keepout=0.1, placement=placement)] * 2]
    places = sample(LayoutSampler(items, EXTENTS), *range(seed, seed + 8))[:, 1:]
    radius = np.linalg.norm(places[..., :2], axis=-1)
    assert (radius >= least - TINY).all()
    assert (radius <= least + width + TINY).all()
    assert (places[..., 2] >= low).all()
    assert (places[..., 2] <= high).all()
    assert (np.linalg.norm(places, axis=-1) <= distance + TINY).all()
    assert (gaps(places, items[1:]) >= -TINY).all()


@given(
    corners=st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.5, 3), st.floats(0.5, 3)), min_size=1),
    seed=seeds,
)
def test_rectangles_hold(corners: list, seed: int) -> None:
    rectangles = tuple((x, y, x + w, y + h) for x, y, w, h in corners)
    item = Item(name="goal", keepout=0.2, placement=Placement(rectangles=rectangles))
    points = sample(LayoutSampler([item], EXTENTS), *range(seed, seed + 20))[:, 0, :2]
    bounds = np.array(rectangles)
    low, high = bounds[:, :2] + 0.2 - TINY, bounds[:, 2:] - 0.2 + TINY
    assert ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=-1).any(axis=-1).all()


def test_rectangles_are_chosen_by_what_the_keepout_leaves_of_them() -> None:
    """1.0 x 2.0 and 1.0 x 1.0 m shrink by 0.2 to 0.6 x 1.6 and 0.6 x 0.6; a third one vanishes."""
    rectangles = ((-2.0, 0.0, -1.0, 2.0), (1.0, 0.0, 2.0, 1.0), (0.0, 0.0, 0.3, 2.0))
    item = Item(name="goal", keepout=0.2, placement=Placement(rectangles=rectangles))
    points = sample(LayoutSampler([item], EXTENTS), *range(4000))[:, 0]
    assert (points[:, 0] < 0).mean() == pytest.approx(1.6 / 2.2, abs=0.03)
    left = points[points[:, 0] < 0]
    assert left[:, 1].mean() == pytest.approx(1.0, abs=0.04)
    assert left[:, 1].std() == pytest.approx(1.6 / np.sqrt(12), abs=0.02)


def test_places_fill_the_area_evenly() -> None:
    places = sample(LayoutSampler(crowd(("goal", 0.4, 1)), EXTENTS), *range(4000))[:, 0]
    quadrant = np.histogram2d(places[:, 0], places[:, 1], bins=2)[0] / 4000
    np.testing.assert_allclose(quadrant, 0.25, atol=0.03)


def test_locations_are_kept_and_the_others_keep_clear_of_them() -> None:
    wall = Item(name="walls", keepout=0.5, location=(0.7, -0.3))
    mark = Item(name="circle", keepout=0.0, location=(0.0, 0.0))
    items = [*crowd(("hazards", 0.4, 4)), mark, wall]
    places = sample(LayoutSampler(items, EXTENTS), *range(200))
    assert (places[:, -1, :2] == (0.7, -0.3)).all()
    assert (places[:, -2, :2] == 0.0).all()
    clear = [i for i, item in enumerate(items) if item is not mark]
    assert (gaps(places[:, clear], [items[i] for i in clear]) >= -TINY).all()
    assert np.linalg.norm(places[:, :-2, :2], axis=-1).min() < 0.3  # a mark keeps nothing free


def test_a_world_does_not_depend_on_its_neighbours() -> None:
    """Neither where layouts succeed at once nor where most are repaired and some given up."""
    for hazards in (8, 12):
        sampler = LayoutSampler(crowd(("hazards", 0.4, hazards)), EXTENTS)
        together = sample(sampler, *range(300))
        for seed in (0, 7, 255, 256, 299):
            np.testing.assert_array_equal(sample(sampler, seed)[0], together[seed])


def test_a_crowd_is_spread_as_if_whole_layouts_were_thrown_away() -> None:
    """Eight ghosts and two targets: mean distances from the origin of GUARD's own rejection, to 0.1 m.

    It throws 370 layouts away for each; 1500 of them gave 1.23 m for the robot, 1.36 for ghosts, 1.51 for targets.
    """
    places = sample(LayoutSampler(crowd(("ghosts", 0.5, 8), ("targets", 0.5, 2)), EXTENTS), *range(400))
    radius = np.linalg.norm(places[..., :2], axis=-1).mean(axis=0)
    assert radius[0] == pytest.approx(1.23, abs=0.1)
    assert radius[1:9].mean() == pytest.approx(1.36, abs=0.1)
    assert radius[9:].mean() == pytest.approx(1.51, abs=0.1)


@pytest.mark.parametrize(
    ("items", "message"),
    [
        (crowd(("hazards", 0.4, 60)), r"no room for 61 items .*60 hazards 0.4.* 30.7 m\^2: use fewer objects"),
        (crowd(("hazards", 0.4, 25)), r"in 40 layouts for 26 items .*larger extents"),
        ([Item(name="goal", keepout=3.0)], r"goal keeps 3.0 m free"),
        (
            [*crowd(), Item(name="wall", keepout=1.9, location=(0.0, 0.0))],
            r"in 40 layouts for 2 items .* 1 robot 0.4, 1 wall 1.9",
        ),
        (
            [Item(name="goal", keepout=0.4, placement=Placement(radius=(3.0, 9.0)))],
            r"goal is asked for 3.0 to 9.0 m from the origin, but its places are 0 to 2.263 m",
        ),
        (
            [Item(name="goal", keepout=0.4, placement=Placement(distance=0.5, heights=(1.0, 2.0)))],
            r"goal is asked for at most 0.5 m .* at least 1 m high",
        ),
    ],
)
def test_the_impossible_is_refused_at_construction_with_its_numbers(items: list[Item], message: str) -> None:
    with pytest.raises(SpecError, match=message) as caught:
        LayoutSampler(items, EXTENTS)
    assert "\n" not in str(caught.value)


def test_a_distance_from_the_robot_that_nothing_has_is_refused_with_it() -> None:
    """The robot stands within 2.263 m of the origin, so nothing in the area is 9 m away from it."""
    item = Item(name="ball", keepout=0.1, placement=Placement(apart=9.0))
    with pytest.raises(SpecError, match=r"1 ball 0.1 \(apart 9.0\), .*smaller keepouts and distances"):
        EpisodeStarter(SceneSpec(robot=load_robot("point")), [group_of(item)], EXTENTS, 1)


@given(request=crowds(things=6, most=1.3), seed=seeds)
def test_any_crowd_is_placed_or_refused(request: tuple, seed: int) -> None:
    """However full the area: what is not refused at construction is placed, and all keepouts hold."""
    items, extents = request
    try:
        sampler = LayoutSampler(items, extents)
    except SpecError as error:
        assert "keepouts" in str(error) or "m free on every side" in str(error)
        return
    assert (gaps(sample(sampler, seed, seed + 1), items) >= -TINY).all()


def test_heights_are_uniform() -> None:
    ball = Item(name="ball", keepout=0.1, placement=Placement(heights=(0.5, 1.5)))
    heights = sample(LayoutSampler([ball], EXTENTS), *range(2000))[:, 0, 2]
    shares = np.histogram(heights, bins=np.linspace(0.5, 1.5, 5))[0] / 2000
    np.testing.assert_allclose(shares, 0.25, atol=0.04)
    assert all(low < high for low, high in pairwise(np.quantile(heights, [0, 0.01, 0.99, 1])))
