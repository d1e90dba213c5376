"""The rule of touch on hand-made contacts, and that conformance notices who breaks it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from guard_api.model.robot import Collision
from guard_api.physics import touch
from guard_api.physics.touch import LinkContacts, TouchSensors, counts
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Pose, Sphere
from guard_api.testing.conformance import find, run_check
from guard_api.testing.robots import floating_tree, touch_sensor
from guard_api.testing.scenes import loose_link
from tests.engines import engine

UP = np.array([0.0, 0.0, 1.0])
EAST = np.array([1.0, 0.0, 0.0])


def contacts(world, link, point, **values):
    """Contacts of 1, 2, ... N pointing up, of links at the origin and at rest."""
    count = len(world)
    still = np.zeros((count, 3))
    given = {"force": 1.0 + np.arange(count), "normal": np.tile(UP, (count, 1)), "position": still,
             "quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))}  # fmt: skip
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


def test_places_turn_with_the_link():
    """A link at (1, 2, 3), turned by a quarter about z, with a sensor half a metre along its x axis."""
    rule = sensors(touch_sensor(floating_tree().links[1].name, place=(0.5, 0.0, 0.0), radius=0.02))
    turned = {"position": np.array([[1.0, 2.0, 3.0]]), "quaternion": np.sqrt([[0.5, 0.0, 0.0, 0.5]])}
    assert rule.force(contacts([0], [1], [1.0, 2.51, 3.0], **turned), 1) == 1.0
    assert rule.force(contacts([0], [1], [1.0, 2.53, 3.0], **turned), 1) == 0.0


SHAPES = {
    "sphere": (Sphere(radius=0.1), 0.1), "box": (Box(half_extents=(0.1, 0.2, 0.2)), 0.3),
    "capsule": (Capsule(radius=0.1, half_length=0.2), 0.3), "cylinder": (Cylinder(radius=0.3, half_length=0.4), 0.7),
    "mesh": (Mesh(vertices=((0.0, 0.0, 0.0), (0.3, 0.0, 0.4)), source=""), 0.5),
}  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
def test_a_sphere_around_the_whole_link_needs_no_places(shape):
    solid, reach = SHAPES[shape]
    turned = Pose(position=(0.0, 0.0, 1.0), quaternion=(0.5, 0.5, 0.5, 0.5))
    hull = loose_link(collisions=(Collision(shape=solid, pose=turned),))
    near, far = (touch_sensor("hull", place=(0.0, 0.0, 1.0), radius=factor * reach) for factor in (1.0, 1.06))
    assert TouchSensors(replace(hull, sensors=(near, far))).limited == (True, False)


def test_a_robot_without_sensors_has_no_touch():
    assert TouchSensors(None).force(contacts([0], [0], [UP]), 3).shape == (3, 0)


class Altered:
    """A real backend that builds touch sensors other than those of the model."""

    def __init__(self, engine, **values):
        self.name, self.capabilities, self._engine, self._values = engine.name, engine.capabilities, engine, values

    def build(self, scene, num_worlds, threads=1):
        changed = tuple(replace(sensor, **self._values) for sensor in scene.robot.sensors)
        return self._engine.build(replace(scene, robot=replace(scene.robot, sensors=changed)), num_worlds, threads)


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


def test_places_of_after_the_substep_are_found_on_bullet(monkeypatch):
    backend = engine("bullet")
    monkeypatch.setattr("guard_bullet.contacts.moved_back", lambda position, quaternion, *rest: (position, quaternion))
    assert run_check(backend, find("touch_keeps_up_with_motion")).status == "failed"


def test_places_of_after_the_substep_are_found_on_sapien(monkeypatch):
    backend = engine("sapien")
    from guard_sapien.contacts import ContactLog

    collect = ContactLog.collect
    monkeypatch.setattr(ContactLog, "collect", lambda log, world: (log.prepare([world]), collect(log, world)))
    assert run_check(backend, find("touch_keeps_up_with_motion")).status == "failed"
