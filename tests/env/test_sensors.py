"""Sensors: known readings, and the properties that make them sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guard_api import kernels
from guard_api.model.robot import Sensor
from guard_api.rotations import from_axis_angle, to_matrix, yaw_quaternion
from guard_api.sensors.inertial import InertialSensors
from guard_api.sensors.lidar import Lidar, compass
from guard_api.shapes import Pose
from guard_api.testing.robots import planar_point
from tests.env.scenery import at_rest, snapshot

ORIGIN, AHEAD = np.zeros((1, 2)), np.zeros(1)
angles = st.floats(-np.pi, np.pi)


def lidar_of(objects: np.ndarray, xy: np.ndarray = ORIGIN, yaw: float = 0.0) -> np.ndarray:
    now = snapshot(xy, np.array([yaw]), things=objects)
    return Lidar().read(now, now.bodies["things"])[0]


def test_an_object_ahead_reads_exp_of_its_distance_in_sector_0() -> None:
    reading = lidar_of(np.array([[[2.0 * np.cos(0.1), 2.0 * np.sin(0.1)]]]))
    share = 0.1 / (2 * np.pi / 16)
    assert reading[0] == pytest.approx(np.exp(-2.0))
    assert reading[1] == pytest.approx(share * np.exp(-2.0))
    assert reading[15] == pytest.approx((1 - share) * np.exp(-2.0))
    assert np.count_nonzero(reading) == 3


SPATIAL = Lidar(bins=10, layers=6)


@pytest.mark.parametrize("settings", [Lidar(), Lidar(aliasing=False), Lidar(max_distance=1.5), SPATIAL])
def test_the_compiled_lidar_reads_what_the_plain_one_reads(settings: Lidar, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    rng = np.random.default_rng(0)
    now = snapshot(rng.uniform(-2, 2, (20, 2)), rng.uniform(-4, 4, 20), things=rng.uniform(-2, 2, (20, 9, 3)))
    now = replace(now, sensing_rotation=to_matrix(_random_quaternions(rng, (20, 1))))
    compiled = settings.read(now, now.bodies["things"])
    monkeypatch.setattr(kernels, "lidar", lambda: None)
    np.testing.assert_allclose(compiled, settings.read(now, now.bodies["things"]), rtol=0, atol=1e-14)


def test_a_spatial_lidar_reads_above_and_below_from_every_frame() -> None:
    now = snapshot(ORIGIN, AHEAD, things=np.array([[[0.0, 0.0, 1.1]]]))  # one metre above the frame
    cells = SPATIAL.read(now, now.bodies["things"]).reshape(10, 6)
    assert cells[:, 5].max() == pytest.approx(np.exp(-1.0))
    assert not cells[:, :5].any()  # it stands in the middle of nothing but the top layer's upper border
    two = replace(now, sensing_position=np.zeros((1, 2, 3)), sensing_rotation=np.tile(np.eye(3), (1, 2, 1, 1)))
    both = SPATIAL.read(two, now.bodies["things"]).reshape(2, 10, 6)
    np.testing.assert_array_equal(both[0], both[1])


def test_a_linear_lidar_ends_at_its_range() -> None:
    now = snapshot(ORIGIN, AHEAD, things=np.array([[[2.9, 0.1], [3.1, 0.1]]]))
    reading = Lidar(max_distance=3.0, aliasing=False).read(now, now.bodies["things"])[0]
    assert reading.max() == pytest.approx(1.0 - np.hypot(2.9, 0.1) / 3.0)


def _random_quaternions(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    q = rng.normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_no_object_reads_zero() -> None:
    assert not lidar_of(np.zeros((1, 0, 2))).any()


@settings(max_examples=50, deadline=None)
@given(turn=angles, seed=st.integers(0, 1000))
def test_lidar_and_compass_turn_with_the_scene(turn: float, seed: int) -> None:
    objects = np.random.default_rng(seed).uniform(-2, 2, (1, 5, 2))
    c, s = np.cos(turn), np.sin(turn)
    turned = objects @ np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(lidar_of(turned, yaw=turn), lidar_of(objects), atol=1e-9)
    before, after = snapshot(ORIGIN, np.zeros(1), things=objects), snapshot(ORIGIN, np.array([turn]), things=turned)
    first, second = (compass(now, now.bodies["things"][:, 0], 2) for now in (before, after))
    np.testing.assert_allclose(first, second, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000))
def test_lidar_ignores_the_order_of_objects(seed: int) -> None:
    rng = np.random.default_rng(seed)
    objects = rng.uniform(-2, 2, (1, 6, 2))
    np.testing.assert_array_equal(lidar_of(objects), lidar_of(objects[:, rng.permutation(6)]))


@settings(max_examples=50, deadline=None)
@given(angle=angles, distance=st.floats(0.1, 3.0))
def test_lidar_is_continuous_in_the_angle(angle: float, distance: float) -> None:
    def at(a: float) -> np.ndarray:
        return lidar_of(distance * np.array([[[np.cos(a), np.sin(a)]]]))

    assert np.abs(at(angle + 1e-7) - at(angle)).max() < 1e-5


def test_compass_points_at_the_target_and_fades_near_it() -> None:
    now = snapshot(ORIGIN, np.array([np.pi / 2]))
    # Heading along +y, a target on +x lies to the right: -y in robot axes. The height of 0.1 m is not seen.
    assert compass(now, np.array([[2.0, 0.0, 0.0]]), 2)[0] == pytest.approx([0.0, -2.0 / 2.001])
    assert np.linalg.norm(compass(now, np.array([[0.0, 1e-6, 0.0]]), 2)) < 0.01


def test_inertial_sensors_at_rest() -> None:
    now = snapshot(ORIGIN, np.array([np.pi / 2]))
    robot = replace(planar_point(), sensors=_sensors(), joints=(), links=planar_point().links[-1:])
    readings = InertialSensors(robot).read(at_rest(now))
    assert readings["accelerometer"][0] == pytest.approx([0.0, 0.0, 9.81])
    assert readings["velocimeter"][0] == pytest.approx([0.0, 0.0, 0.0])
    assert readings["magnetometer"][0] == pytest.approx([-0.5, 0.0, 0.0])


def test_inertial_sensors_in_motion() -> None:
    now = snapshot(ORIGIN, np.array([np.pi / 2]))
    now.state.link_linear_velocity[0, 0] = [0.0, 1.5, 0.0]
    now.state.link_angular_velocity[0, 0] = [0.0, 0.0, 3.0]
    previous = snapshot(ORIGIN, np.array([np.pi / 2]))
    robot = replace(planar_point(), sensors=_sensors(), joints=(), links=planar_point().links[-1:])
    readings = InertialSensors(robot).read(replace(at_rest(now), previous=previous))
    assert readings["velocimeter"][0] == pytest.approx([1.5, 0.0, 0.0])
    assert readings["gyro"][0] == pytest.approx([0.0, 0.0, 3.0])
    assert readings["accelerometer"][0] == pytest.approx([1.5 / 0.02, 0.0, 9.81])


def test_a_site_away_from_the_link_origin_sees_the_turning() -> None:
    now = snapshot(ORIGIN, np.zeros(1))
    now.state.link_angular_velocity[0, 0] = [0.0, 0.0, 2.0]
    site = Pose(position=(0.5, 0.0, 0.0), quaternion=tuple(from_axis_angle([0, 0, 1], np.float64(np.pi / 2))))
    link = planar_point().links[-1]
    sensor = Sensor(name="velocimeter", kind="velocimeter", link=link.name, pose=site)
    robot = replace(planar_point(), sensors=(sensor,), joints=(), links=(link,))
    # v = w x r = (0, 1, 0); the site's x axis is the link's y axis.
    assert InertialSensors(robot).read(at_rest(now))["velocimeter"][0] == pytest.approx([1.0, 0.0, 0.0])
    assert yaw_quaternion(np.pi / 2) == pytest.approx(site.quaternion)


def _sensors() -> tuple[Sensor, ...]:
    link = planar_point().links[-1].name
    kinds = ("accelerometer", "velocimeter", "gyro", "magnetometer")
    return tuple(Sensor(name=kind, kind=kind, link=link) for kind in kinds)
