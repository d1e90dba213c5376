"""What makes lidar and compass sensors, in the plane and in space, in their compiled and their plain forms."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from guard_api import kernels
from guard_api.errors import SpecError
from guard_api.physics.transition import Snapshot
from guard_api.rotations import to_matrix
from guard_api.sensors.lidar import Lidar, compass
from tests.env.scenery import snapshot

LIDARS = [Lidar(), Lidar(bins=10, layers=6), Lidar(max_distance=3.0), Lidar(bins=10, layers=6, aliasing=False)]
both_forms = pytest.mark.parametrize("plain", [False, True], ids=["compiled", "plain"])
every_lidar = pytest.mark.parametrize("lidar", LIDARS, ids=["plane", "space", "linear", "unaliased"])
seeds = st.integers(0, 2**32 - 1)


@contextmanager
def form(plain: bool) -> Iterator[None]:
    """Run the plain form, as without numba, or whichever is installed."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in list(vars(kernels).items()):
            if plain and hasattr(value, "cache_clear"):
                patch.setattr(kernels, name, lambda: None)
        yield


def random_turn(rng: np.random.Generator) -> np.ndarray:
    quaternion = rng.normal(size=4)
    return to_matrix(quaternion / np.linalg.norm(quaternion))


def scene(objects: np.ndarray, turn: np.ndarray) -> Snapshot:
    """A robot at the origin with one sensing frame there, turned by `turn` (3, 3), among `objects` (K, 3)."""
    now = snapshot(np.zeros((1, 2)), np.zeros(1), things=objects[None])
    return replace(
        now,
        position=np.zeros((1, 3)),
        rotation=turn[None],
        sensing_position=np.zeros((1, 1, 3)),
        sensing_rotation=turn[None, None],
    )


def read(lidar: Lidar, objects: np.ndarray, turn: np.ndarray | None = None) -> np.ndarray:
    now = scene(objects, np.eye(3) if turn is None else turn)
    return lidar.read(now, now.bodies["things"])[0]


def around_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@both_forms
@every_lidar
@given(seed=seeds)
def test_readings_turn_with_the_scene(lidar: Lidar, plain: bool, seed: int) -> None:
    """Robot and objects turned together are seen the same: about the vertical in the plane, about any axis in space."""
    rng = np.random.default_rng(seed)
    objects = rng.uniform(-2, 2, (5, 3)) * ([1, 1, 1] if lidar.layers else [1, 1, 0])
    turn = random_turn(rng) if lidar.layers else around_z(rng.uniform(0, 6))
    with form(plain):
        np.testing.assert_allclose(read(lidar, objects @ turn.T, turn), read(lidar, objects), atol=1e-9)
        axes = 3 if lidar.layers else 2
        one, other = scene(objects, np.eye(3)), scene(objects @ turn.T, turn)
        np.testing.assert_allclose(
            compass(one, one.bodies["things"][:, 0], axes),
            compass(other, other.bodies["things"][:, 0], axes),
            atol=1e-9,
        )


@both_forms
@every_lidar
@given(seed=seeds)
def test_objects_hide_nothing_and_have_no_order(lidar: Lidar, plain: bool, seed: int) -> None:
    """All of them read the largest of what each reads alone, also where one stands behind another."""
    rng = np.random.default_rng(seed)
    objects = rng.uniform(-2, 2, (5, 3))
    objects[1] = 1.5 * objects[0]
    with form(plain):
        together = read(lidar, objects)
        alone = np.max([read(lidar, objects[i : i + 1]) for i in range(5)], axis=0)
        np.testing.assert_array_equal(together, alone)
        np.testing.assert_array_equal(together, read(lidar, objects[rng.permutation(5)]))


@both_forms
@every_lidar
@given(seed=seeds, further=st.floats(1.01, 3.0))
def test_what_is_further_reads_less(lidar: Lidar, plain: bool, seed: int, further: float) -> None:
    """In no cell more and in its own less, down to zero at the end of a linear lidar's range."""
    place = np.random.default_rng(seed).uniform(0.1, 1.0, (1, 3))
    with form(plain):
        near, far = read(lidar, place), read(lidar, further * place)
    assert (far <= near + 1e-12).all()
    assert far.max() < near.max()
    assert 0.0 < near.max() <= 1.0


@both_forms
def test_a_planar_reading_tells_the_azimuth_to_rounding(plain: bool) -> None:
    """Its own sector and the share that the next one reads; also at and beside every 22.5 degrees."""
    eighths = np.arange(-8, 9)[:, None] * np.pi / 8 + np.array([0.0, 1e-12, -1e-12, 1e-3, -1e-3])
    angles = np.concatenate([eighths.reshape(-1), np.random.default_rng(0).uniform(-np.pi, np.pi, 1000)])
    with form(plain):
        cells = np.stack([read(Lidar(), np.array([[np.cos(a), np.sin(a), 0.0]])) for a in angles]) * np.e
    own = cells.argmax(axis=1)
    told = (own + cells[np.arange(len(own)), (own + 1) % 16]) * 2 * np.pi / 16
    np.testing.assert_allclose(np.exp(1j * told), np.exp(1j * angles), atol=1e-14)


@both_forms
@pytest.mark.parametrize("lidar", [LIDARS[0], LIDARS[2]], ids=["plane", "linear"])
@given(border=st.integers(-16, 16), beside=st.floats(-0.2, 0.2), distance=st.floats(0.1, 2.5))
def test_readings_are_continuous_around_the_robot(
    lidar: Lidar, plain: bool, border: int, beside: float, distance: float
) -> None:
    """Also where an object passes from one sector to the next, which random angles never meet."""

    def at(a: float) -> np.ndarray:
        return read(lidar, distance * np.array([[np.cos(a), np.sin(a), 0.0]]))

    with form(plain):
        for angle in (border * 2 * np.pi / lidar.bins, border * 2 * np.pi / lidar.bins + beside):
            assert np.abs(at(angle + 1e-7) - at(angle - 1e-7)).max() < 1e-5


@both_forms
@given(sector=st.integers(0, 9), layer=st.floats(0.05, 0.95), distance=st.floats(0.1, 2.5))
def test_in_space_only_the_cells_above_and_below_jump(plain: bool, sector: int, layer: float, distance: float) -> None:
    """Diagonal cells read nothing, as in GUARD: at a border between sectors the object's own layer is continuous."""
    assume(abs(6 * layer - round(6 * layer)) > 1e-6)  # on a border between layers rounding decides which is its own
    elevation = (layer - 0.5) * np.pi
    height, radius = distance * np.sin(elevation), distance * np.cos(elevation)
    own = min(int(layer * 6), 5)

    def at(a: float) -> np.ndarray:
        return read(LIDARS[1], np.array([[radius * np.cos(a), radius * np.sin(a), height]])).reshape(10, 6)

    angle = sector * 2 * np.pi / 10
    with form(plain):
        jump = np.abs(at(angle + 1e-7) - at(angle - 1e-7))
    assert jump[:, own].max() < 1e-5
    assert jump.max() > 0.01 * np.exp(-distance)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"bins": 0}, "Lidar.bins is 0: it must be a whole number from 1 to 1000"),
        ({"bins": 16.0}, "Lidar.bins is 16.0"),
        ({"bins": True}, "Lidar.bins is True"),
        ({"bins": 10**12}, "Lidar.bins is 1000000000000"),
        ({"layers": -1}, "Lidar.layers is -1: it must be a whole number from 0 to 1000"),
        ({"gain": -0.5}, "Lidar.gain is -0.5: it must be a finite number of at least 0"),
        ({"gain": float("inf")}, "Lidar.gain is inf"),
        ({"gain": float("nan")}, "Lidar.gain is nan"),
        ({"max_distance": 0.0}, "Lidar.max_distance is 0.0: it must be a finite number above 0"),
        ({"max_distance": float("inf")}, "Lidar.max_distance is inf"),
    ],
)
def test_a_lidar_without_readings_is_refused(settings: dict[str, Any], message: str) -> None:
    """Before the compiled form writes them where no memory is."""
    with pytest.raises(SpecError, match=message):
        Lidar(**settings)
    with pytest.raises(SpecError, match=message):
        replace(Lidar(), **settings)


@pytest.mark.parametrize("settings", [{"bins": 1}, {"gain": 0.0}, {"bins": 1, "layers": 1}])
@both_forms
def test_the_least_lidar_reads(settings: dict[str, Any], plain: bool) -> None:
    lidar = Lidar(**settings)
    with form(plain):
        reading = read(lidar, np.array([[0.3, 0.4, 0.0]]))
    assert reading.shape == (lidar.bins * max(lidar.layers, 1),)
    assert reading.max() == pytest.approx(np.exp(-lidar.gain * 0.5))


@given(seed=seeds, axes=st.sampled_from([2, 3]))
def test_the_compiled_compass_points_where_the_plain_one_points(seed: int, axes: int) -> None:
    pytest.importorskip("numba")
    rng = np.random.default_rng(seed)
    now = scene(rng.uniform(-2, 2, (1, 3)), random_turn(rng))
    compiled = compass(now, now.bodies["things"][:, 0], axes)
    with form(plain=True):
        np.testing.assert_allclose(compiled, compass(now, now.bodies["things"][:, 0], axes), rtol=0, atol=1e-14)
