"""Goal and hazards: rewards and costs that must fire, and must not."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api.constraints import Hazards
from guard_api.tasks import Goal
from tests.env.scenery import at_rest, moved, snapshot

ORIGIN, AHEAD = np.zeros((1, 2)), np.zeros(1)


def test_goal_pays_the_distance_gained() -> None:
    now = snapshot(ORIGIN, AHEAD, goal=np.array([[[1.5, 0.0]]]))
    assert Goal().reward(moved(now, (0.03, 0.0)))[0] == pytest.approx(0.03)
    assert Goal().reward(moved(now, (-0.03, 0.0)))[0] == pytest.approx(-0.03)
    assert Goal().reward(at_rest(now))[0] == 0.0


def test_the_goal_is_reached_inside_and_only_inside() -> None:
    for distance, inside in ((0.0, True), (0.5, True), (0.5001, False)):
        now = snapshot(ORIGIN, AHEAD, goal=np.array([[[distance, 0.0]]]))
        assert Goal().reached(at_rest(now))[0] == inside
        assert Goal().reward(at_rest(now))[0] == 0.0


def test_hazards_cost_their_depth() -> None:
    hazards = Hazards(count=2)
    far = np.array([3.0, 3.0])
    for distance, cost in ((0.0, 0.3), (0.1, 0.2), (0.2999, 0.0001), (0.3, 0.0), (1.0, 0.0)):
        now = snapshot(ORIGIN, AHEAD, hazards=np.array([[[distance, 0.0], far]]))
        assert hazards.cost(at_rest(now))[0] == pytest.approx(cost)
        assert hazards.indicator(at_rest(now))[0] == (cost > 0)


def test_hazards_add_up_and_the_height_does_not_count() -> None:
    now = snapshot(ORIGIN, AHEAD, hazards=np.array([[[0.1, 0.0, 5.0], [0.0, 0.1, -5.0]]]))
    assert Hazards(count=2).cost(at_rest(now))[0] == pytest.approx(0.4)
    assert Hazards(count=2, weight=2.0).cost(at_rest(now))[0] == pytest.approx(0.8)


def test_no_hazards_no_cost() -> None:
    now = snapshot(ORIGIN, AHEAD, hazards=np.zeros((1, 0, 2)))
    assert Hazards(count=0).cost(at_rest(now))[0] == 0.0
