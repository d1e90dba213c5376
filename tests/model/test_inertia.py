"""Inertia: closed forms against integration, and the laws that any inertia obeys."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guard_api import rotations
from guard_api.model.inertia import (
    MassProperties,
    combined,
    impossibility,
    moved,
    of_shape,
    of_solids,
    positive_definite,
)
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Pose, Shape, Sphere
from tests.model.random_robots import lengths, mass_properties, poses, shapes


def about(properties: MassProperties, point: np.ndarray) -> np.ndarray:
    """Inertia about any point: the parallel-axis theorem, stated independently."""
    r = np.asarray(properties.com) - point
    cross = np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
    return np.asarray(properties.inertia) - properties.mass * cross @ cross


def inside(shape: Shape, p: np.ndarray) -> np.ndarray:
    x, y, z = p.T
    match shape:
        case Sphere(radius=r):
            return x**2 + y**2 + z**2 <= r**2
        case Box(half_extents=half):
            return (np.abs(p) <= half).all(axis=1)
        case Cylinder(radius=r, half_length=h):
            return (x**2 + y**2 <= r**2) & (np.abs(z) <= h)
        case Capsule(radius=r, half_length=h):
            return x**2 + y**2 + np.maximum(np.abs(z) - h, 0.0) ** 2 <= r**2
    raise TypeError(shape)


@pytest.mark.parametrize(
    "shape",
    [
        Sphere(radius=0.7),
        Box(half_extents=(0.2, 0.5, 0.9)),
        Cylinder(radius=0.4, half_length=0.8),
        Capsule(radius=0.4, half_length=0.5),
    ],
)
def test_closed_forms_match_a_sum_over_a_fine_grid(shape: Shape) -> None:
    cells = 140
    ticks = (np.arange(cells) + 0.5) / cells * 2.0 - 1.0
    points = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    points = points[inside(shape, points)]
    weight = 3.0 * (2.0 / cells) ** 3
    second = weight * points.T @ points
    properties = of_shape(shape, 3.0)
    assert properties.mass == pytest.approx(weight * len(points), rel=0.01)
    np.testing.assert_allclose(properties.inertia, np.trace(second) * np.eye(3) - second, rtol=0.02, atol=1e-6)


@given(mass_properties(), poses())
def test_moving_a_body_keeps_its_mass_and_principal_moments(body: MassProperties, pose: Pose) -> None:
    there = moved(body, pose)
    scale = np.linalg.norm(body.inertia)
    assert there.mass == body.mass
    np.testing.assert_allclose(
        np.linalg.eigvalsh(there.inertia), np.linalg.eigvalsh(body.inertia), rtol=0, atol=1e-13 * scale
    )
    np.testing.assert_allclose(
        rotations.unrotate(pose.quaternion, np.subtract(there.com, pose.position)), body.com, atol=1e-13
    )


@given(st.lists(mass_properties(), min_size=1, max_size=4), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_moments_about_any_point_add_up(parts: list[MassProperties], point: tuple[float, ...]) -> None:
    whole = combined(parts)
    expected = sum(about(part, np.array(point)) for part in parts)
    np.testing.assert_allclose(about(whole, np.array(point)), expected, rtol=0, atol=1e-12 * np.linalg.norm(expected))
    first = sum(part.mass * np.array(part.com) for part in parts)
    np.testing.assert_allclose(whole.mass * np.array(whole.com), first, atol=1e-12 * whole.mass)


@given(st.lists(st.tuples(shapes, poses()), min_size=1, max_size=3), poses())
def test_turning_the_whole_turns_the_parts(solids: list[tuple[Shape, Pose]], pose: Pose) -> None:
    parts = [moved(of_shape(shape, 7.0), at) for shape, at in solids]
    a, b = moved(combined(parts), pose), combined([moved(part, pose) for part in parts])
    np.testing.assert_allclose(a.com, b.com, atol=1e-12)
    np.testing.assert_allclose(a.inertia, b.inertia, rtol=0, atol=1e-12 * np.linalg.norm(b.inertia) + 1e-12 * b.mass)


@given(shapes, st.floats(0.1, 1e4))
def test_solids_are_physically_possible_and_scale_with_density(shape: Shape, density: float) -> None:
    one, many = of_shape(shape, 1.0), of_shape(shape, density)
    assert impossibility(one.inertia) is None
    assert positive_definite(one.inertia)
    assert many.mass == pytest.approx(density * one.mass, rel=1e-14)
    np.testing.assert_allclose(many.inertia, density * np.array(one.inertia), rtol=1e-14)


@given(st.tuples(lengths, lengths, lengths), poses())
def test_the_hull_of_a_boxs_corners_is_the_box(half: tuple[float, float, float], pose: Pose) -> None:
    box = Box(half_extents=half)
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    corners = rotations.rotate(pose.quaternion, signs * half) + np.array(pose.position)
    hull = of_shape(Mesh(vertices=tuple(map(tuple, corners.tolist())), source="test"), 5.0)
    expected = moved(of_shape(box, 5.0), pose)
    assert hull.mass == pytest.approx(expected.mass, rel=1e-9)
    np.testing.assert_allclose(hull.com, expected.com, atol=1e-9)
    np.testing.assert_allclose(hull.inertia, expected.inertia, rtol=0, atol=1e-9 * np.linalg.norm(expected.inertia))


def test_the_hull_of_a_fine_sphere_approaches_the_sphere() -> None:
    count = 4000
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    points = 0.3 * np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    points += (0.5, -0.2, 0.1)
    hull = of_shape(Mesh(vertices=tuple(map(tuple, points.tolist())), source="test"), 2.0)
    ball = of_shape(Sphere(radius=0.3), 2.0)
    assert hull.mass == pytest.approx(ball.mass, rel=2e-3)
    assert hull.mass < ball.mass
    np.testing.assert_allclose(hull.com, (0.5, -0.2, 0.1), atol=1e-5)
    np.testing.assert_allclose(hull.inertia, ball.inertia, rtol=0, atol=4e-3 * ball.inertia[0][0])


def test_a_flat_mesh_has_no_volume() -> None:
    flat = Mesh(vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)), source="flat")
    with pytest.raises(ValueError, match="one plane"):
        of_shape(flat, 1.0)


def test_overlaps_count_twice() -> None:
    ball = (Sphere(radius=0.2), Pose())
    assert of_solids([ball, ball], 1.0).mass == pytest.approx(2.0 * of_solids([ball], 1.0).mass)


@pytest.mark.parametrize(
    ("moments", "word"),
    [((1.0, 1.0, 2.5), "exceeds"), ((-1.0, 1.0, 1.0), "positive definite"), ((-1.0, -1.0, -1.0), "positive definite")],
)
def test_impossible_inertias_are_told_with_the_reason(moments: tuple[float, ...], word: str) -> None:
    R = rotations.to_matrix(rotations.from_rpy(0.3, 1.0, -2.0))
    inertia = R @ np.diag(moments) @ R.T
    assert word in str(impossibility(tuple(map(tuple, inertia.tolist()))))


@given(mass_properties())
def test_possible_inertias_are_accepted(body: MassProperties) -> None:
    assert impossibility(body.inertia) is None


def test_thin_bodies_on_the_edge_are_accepted() -> None:
    assert impossibility(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0))) is None
