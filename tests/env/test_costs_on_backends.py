"""Costs on every backend: what must fire fires, and its neighbour two centimetres away does not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from guard_api import plugins
from guard_api.constraints import Buttons, Constraint, Ghosts, Gremlins, Hazards, Pillars, Vases, Walls
from guard_api.env import Environment
from guard_api.tasks import Chase, Goal, Task
from guard_api.tasks.targets import Targets
from tests.env.staging import drive, put, spec_with

ROBOT = 0.1
"""Radius of the Point [m]; its arrow ends 0.15 m ahead of its centre."""

CLEAR = 0.02
"""How far the robot of world 1 passes by what the robot of world 0 runs into [m]."""

AHEAD = (1.0, 0.0)
STILL = (0.0, 0.0)
AWAY = np.array([[50.0, 50.0]])


@contextmanager
def stage(backend: str, *constraints: Constraint, task: Task | None = None) -> Iterator[Environment]:
    """Two worlds of Point."""
    spec = spec_with("Goal_Point_8Hazards", task=task or Goal(), constraints=constraints)
    env = Environment(spec, backend=backend, num_worlds=2, workers=1)
    yield env
    env.close()


def needs_contacts(backend: str) -> None:
    if not plugins.load("guard.backends", backend).capabilities.contacts:
        pytest.skip("the backend has no contacts")


def beside(x: float, half_width: float) -> np.ndarray:
    """One object: in the way of the robot in world 0, just beside its way in world 1."""
    return np.array([[[x, 0.0]], [[x, half_width + ROBOT + CLEAR]]])


@pytest.mark.parametrize("heights", [None, (0.1, 0.1)], ids=["discs", "balls"])
def test_zones_cost_their_depth(backend_name: str, heights: tuple | None) -> None:
    """A zone's cost depends on the robot's centre alone: it goes through one, and 1 cm beside the other."""
    size = 0.3
    zones = (Hazards(count=1, size=size, heights=heights), Ghosts(count=1, size=size, heights=heights))
    with stage(backend_name, *zones) as env:
        places = np.array([[[0.8, 0.0, 0.1]], [[0.8, size + 0.01, 0.1]]])
        put(env, np.zeros((1, 2)), goal=AWAY, hazards=places, ghosts=places)
        _, costs = drive(env, AHEAD, 70)
        assert env.snapshot.position[0, 0] > 0.8 + size
        np.testing.assert_allclose(costs[:, 0].max(axis=0), size, atol=0.02)
        assert not costs[[0, -1], 0].any()
        assert not costs[:, 1].any()


@pytest.mark.parametrize(
    ("constraint", "half_width"),
    [(Pillars(count=1), 0.2), (Walls(count=1), 0.5), (Buttons(count=1), 0.1)],
    ids=["pillar", "wall", "button"],
)
def test_what_stands_in_the_way_stops_the_robot_and_costs_one_a_step(
    backend_name: str, constraint: Constraint, half_width: float
) -> None:
    needs_contacts(backend_name)
    with stage(backend_name, constraint) as env:
        put(env, np.zeros((1, 2)), goal=AWAY, **{constraint.name: beside(half_width + 0.4, half_width)})
        _, costs = drive(env, AHEAD, 90)
        assert set(np.unique(costs[:, 0])) == {0.0, 1.0}
        first = int(costs[:, 0, 0].argmax())
        assert costs[first:, 0, 0].mean() > 0.5  # it stays pressed against it
        assert env.snapshot.position[0, 0] < 0.4
        assert not costs[:, 1].any()
        assert env.snapshot.position[1, 0] > 1.0


def test_a_vase_costs_when_touched_and_for_its_speed(backend_name: str) -> None:
    needs_contacts(backend_name)
    with stage(backend_name, Vases(count=1)) as env:
        put(env, np.zeros((1, 2)), goal=AWAY, vases=beside(0.5, 0.1))
        _, costs = drive(env, AHEAD, 60)
        touched = costs[:, 0, 0].max()
        assert 1.0 < touched < 3.0  # one for the touch, and its speed [m/s]
        assert not costs[:, 1].any()  # nor does a vase at rest cost anything by the noise of its contacts
        assert env.snapshot.bodies["vases"][0, 0, 0] > 0.6
        np.testing.assert_allclose(env.snapshot.bodies["vases"][1, 0, :2], [0.5, 0.22], atol=1e-3)


def test_a_displaced_vase_goes_on_costing(backend_name: str) -> None:
    needs_contacts(backend_name)
    vases = Vases(count=1, contact_weight=0.0, velocity_weight=0.0, displacement_weight=1.0)
    with stage(backend_name, vases) as env:
        put(env, np.zeros((1, 2)), goal=AWAY, vases=beside(0.5, 0.1))
        drive(env, AHEAD, 45)
        _, costs = drive(env, (-1.0, 0.0), 60)
        moved = env.snapshot.bodies["vases"][0, 0, :2] - [0.5, 0.0]
        assert costs[-1, 0, 0] == pytest.approx(np.linalg.norm(moved))
        assert costs[-1, 0, 0] > 0.1
        assert not costs[:, 1].any()


def test_a_gremlin_pushes_the_robot_on_its_circle_and_keeps_its_course(backend_name: str) -> None:
    needs_contacts(backend_name)
    gremlins = Gremlins(count=1, period=2.0)
    outside = gremlins.travel + gremlins.size * 2**0.5 + ROBOT + CLEAR
    with stage(backend_name, gremlins) as env:
        put(env, np.array([[0.25, 0.05], [outside, 0.0]]), goal=AWAY,
            gremlins=np.zeros((1, 1, 2)))  # fmt: skip
        _, costs = drive(env, STILL, 120)
        assert costs[:, 0].any()
        assert not costs[:, 1].any()
        assert np.hypot(*(env.snapshot.position[0, :2] - [0.25, 0.05])) > 0.05
        phase = np.pi * env.snapshot.state.time
        circle = gremlins.travel * np.stack([np.sin(phase), np.cos(phase)], axis=1)
        np.testing.assert_allclose(env.snapshot.bodies["gremlins"][:, 0, :2], circle, atol=1e-4)


@pytest.mark.parametrize("heights", [None, (0.2, 0.2)], ids=["cylinder", "ball"])
def test_a_solid_ghost_pushes_and_costs_one_a_step(backend_name: str, heights: tuple | None) -> None:
    needs_contacts(backend_name)
    ghosts = Ghosts(count=1, solid=True, respect=0.0, speed=0.5, heights=heights)
    with stage(backend_name, ghosts) as env:
        places = np.array([[[-0.6, 0.0]], [[-1.2, 0.0]]])
        if heights:
            places = np.concatenate([places, np.full((2, 1, 1), 0.2)], axis=-1)
        put(env, np.zeros((1, 2)), goal=AWAY, ghosts=places)
        # In 0.8 s the ghost of world 0 would reach x = -0.2, where the robot must give way; that of world 1 -0.8.
        _, costs = drive(env, STILL, 40)
        assert set(np.unique(costs[:, 0])) == {0.0, 1.0}
        assert not costs[:, 1].any()
        assert env.snapshot.position[0, 0] > 0.1
        gap = env.snapshot.position[0, 0] - env.snapshot.bodies["ghosts"][0, 0, 0]
        assert gap > 0.37  # 0.4 for the cylinder, 0.387 for the ball, whose centre is higher
        np.testing.assert_allclose(env.snapshot.position[1, :2], 0.0, atol=1e-3)


def test_a_solid_target_flees_undisturbed_and_holds_the_robot_up(backend_name: str) -> None:
    needs_contacts(backend_name)
    with stage(backend_name, task=Chase(targets=Targets(count=1, solid=True))) as env:
        put(env, np.array([[-1.0, 0.0]]), targets=np.array([[[-0.5, 0.0]]]))
        drive(env, AHEAD, 50)
        before = env.snapshot
        drive(env, AHEAD, 10)
        gone = env.snapshot.bodies["targets"][:, 0, 0] - before.bodies["targets"][:, 0, 0]
        np.testing.assert_allclose(gone, 0.10, atol=1e-4)
        np.testing.assert_allclose(env.snapshot.position[:, 0] - before.position[:, 0], 0.10, atol=0.01)
