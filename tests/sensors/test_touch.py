"""The rule of touch on hand-made contacts, and that conformance notices who breaks it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from guard_api import plugins
from guard_api.errors import PluginError
from guard_api.physics import touch
from guard_api.physics.touch import LinkContacts, TouchSensors, counts
from guard_api.shapes import Pose
from guard_api.testing.conformance import find, run_check
from guard_api.testing.robots import floating_tree, touch_sensor

UP = np.array([0.0, 0.0, 1.0])
EAST = np.array([1.0, 0.0, 0.0])


def contacts(world, link, point, **values):
    """Contacts of 1, 2, ... N pointing up, of links at the origin and at rest."""
    count = len(world)
    still = np.zeros((count, 3))
    given = {"force": 1.0 + np.arange(count), "normal": np.tile(UP, (count, 1)), "position": still,
             "quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), "com_velocity": still,
             "angular_velocity": still}  # fmt: skip
    return LinkContacts(
        world=np.array(world), link=np.array(link), point=np.array(point, float).reshape(-1, 3), **given | values
    )


def sensors(*of_robot):
    return TouchSensors(replace(floating_tree(), sensors=of_robot))


@pytest.mark.parametrize(
    ("place", "expected"),
    [((0, 0, 0), True), ((0, 0, 0.19), True), ((0, 0.19, 0), True), ((0, 0.21, 0), False), ((0, 0, 5), True),
     ((0, 0.19, 5), True), ((0, 0.21, 5), False), ((0, 0, -0.19), True), ((0, 0, -0.21), False),
     ((0, 0.19, -0.19), False)],
)  # fmt: skip
def test_a_contact_counts_whose_ray_meets_the_sphere(place, expected):
    assert bool(counts(np.zeros(3), UP, np.array(place, float), 0.2)) is expected


def test_every_sensor_adds_up_its_own():
    """One on all of link 1, one on each side of it, one on link 2; contacts of two worlds, in any order."""
    robot = floating_tree()
    near, far = robot.links[1].name, robot.links[2].name
    west, east = (touch_sensor(near, place=(x, 0, 0), radius=0.1, name=f"side{x}") for x in (-1, 1))
    rule = sensors(touch_sensor(near), west, east, touch_sensor(far))
    points = [-EAST, EAST, EAST, 0 * EAST, EAST]
    found = contacts([1, 0, 1, 1, 0], [1, 1, 1, 1, 2], points)
    np.testing.assert_array_equal(rule.force(found, 2), [[2, 0, 2, 5], [8, 1, 3, 0]])
    assert (len(rule), rule.links, rule.located) == (4, {1, 2}, {1})


def test_places_go_back_to_where_the_contact_was_found():
    """A link that moved and turned about its centre of mass for 10 ms after it was touched."""
    robot = floating_tree()
    name, com = robot.links[1].name, np.array(robot.links[1].com)
    rule = sensors(touch_sensor(name, place=(0.0, 0.3, 0.0), radius=0.02))
    velocity, spin = np.array([[4.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 2.0]])
    then = np.array([0.0, 0.3, 0.0]) - 0.01 * (velocity[0] + np.cross(spin[0], np.array([0.0, 0.3, 0.0]) - com))
    found = contacts([0], [1], [then], com_velocity=velocity, angular_velocity=spin)
    assert rule.force(found, 1) == 0.0
    assert rule.force(replace(found, age=0.01), 1) == 1.0
    missed = replace(found, age=0.01, point=then[None] + 0.03 * EAST)
    assert rule.force(missed, 1) == 0.0


def test_a_robot_without_sensors_has_no_touch():
    assert TouchSensors(None).force(contacts([0], [0], [UP]), 3).shape == (3, 0)


class Altered:
    """A real backend that builds touch sensors other than those of the model."""

    def __init__(self, engine, **values):
        self.name, self.capabilities, self._engine, self._values = engine.name, engine.capabilities, engine, values

    def build(self, scene, num_worlds, threads=1):
        changed = tuple(replace(sensor, **self._values) for sensor in scene.robot.sensors)
        return self._engine.build(replace(scene, robot=replace(scene.robot, sensors=changed)), num_worlds, threads)


def engine(name):
    try:
        return plugins.load("guard.backends", name)
    except PluginError as problem:
        pytest.skip(str(problem))


FAULTS = {"places at the link's frame": {"pose": Pose()}, "no radius": {"radius": float("inf")}}


@pytest.mark.parametrize("name", ["mujoco", "bullet", "sapien"])
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("clause", ["touch_is_within_the_radius", "touch_is_shared_by_place"])
def test_sensors_elsewhere_are_found(clause, fault, name):
    assert run_check(Altered(engine(name), **FAULTS[fault]), find(clause)).status == "failed"


@pytest.mark.parametrize("name", ["bullet", "sapien"])
def test_rays_into_the_link_are_found(monkeypatch, name):
    monkeypatch.setattr(touch, "counts", lambda point, normal, place, radius: counts(point, -normal, place, radius))
    assert run_check(engine(name), find("touch_is_within_the_radius")).status == "failed"


@pytest.mark.parametrize("name", ["bullet", "sapien"])
def test_places_of_after_the_substep_are_found(monkeypatch, name):
    late = TouchSensors.force
    monkeypatch.setattr(TouchSensors, "force", lambda self, c, n: late(self, replace(c, age=0.0), n))
    assert run_check(engine(name), find("touch_keeps_up_with_motion")).status == "failed"
