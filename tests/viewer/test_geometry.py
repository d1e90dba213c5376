"""What pictures are made of: closed surfaces, cameras that have everything in view."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from guard_api.viewer.camera import Camera
from guard_api.viewer.surfaces import surface

CUBE = Mesh(vertices=tuple((x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)), source="here")
VOLUMES: list[tuple[Shape, float]] = [
    (Sphere(radius=0.5), 4 / 3 * np.pi * 0.5**3),
    (Box(half_extents=(0.1, 0.2, 0.3)), 8 * 0.1 * 0.2 * 0.3),
    (Cylinder(radius=0.5, half_length=0.2), np.pi * 0.5**2 * 0.4),
    (Capsule(radius=0.1, half_length=0.5), np.pi * 0.1**2 * 1.0 + 4 / 3 * np.pi * 0.1**3),
    (CUBE, 1.0),
]


@pytest.mark.parametrize(("shape", "volume"), VOLUMES, ids=lambda value: type(value).__name__)
def test_surfaces_enclose_the_volume_of_their_shape(shape: Shape, volume: float) -> None:
    own = surface(shape)
    mesh = trimesh.Trimesh(vertices=own.vertices, faces=own.faces, process=False)
    assert mesh.volume == pytest.approx(volume, rel=5e-3), "also: faces are wound outwards"
    assert np.linalg.norm(own.normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    centre = own.vertices[own.faces].mean(axis=1) - own.vertices.mean(axis=0)
    assert (np.einsum("ij,ij->i", own.normals[own.faces[:, 0]], centre) > 0).all(), "normals point outwards"


def test_a_hull_is_sharp_at_its_edges() -> None:
    own = surface(CUBE)
    assert np.abs(own.normals).max(axis=1) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("azimuth", np.linspace(-3.0, 3.0, 5))
@pytest.mark.parametrize("elevation", [-0.3, 0.1, 1.5])
@pytest.mark.parametrize("aspect", [0.5, 2.0])
def test_a_framing_camera_has_everything_in_view_and_wastes_no_room(
    azimuth: float, elevation: float, aspect: float
) -> None:
    points = np.random.default_rng(1).normal(size=(50, 3)) * (2.0, 1.0, 0.3) + (5.0, -2.0, 0.4)
    camera = Camera(azimuth=azimuth, elevation=elevation, margin=1.0).framing(points, aspect)
    side = seen(camera, points) / (np.tan(0.5 * camera.field_of_view) * np.array([aspect, 1.0]))
    assert np.abs(side).max() == pytest.approx(1.0, abs=1e-3)
    assert side.max(axis=0) + side.min(axis=0) == pytest.approx(0.0, abs=1e-3)


def test_what_the_user_fixes_stays() -> None:
    camera = Camera(target=(1.0, 2.0, 3.0), distance=4.0).framing(np.zeros((1, 3)), 1.0)
    assert camera.target == pytest.approx((1.0, 2.0, 3.0))
    assert camera.distance == 4.0
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    camera = Camera(target=(0.0, 0.0, 0.0)).framing(points, 1.0)
    assert np.abs(seen(camera, points)).max() < np.tan(0.5 * camera.field_of_view)


def seen(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Where the points (P, 3) are in the picture, (P, 2), as tangents right and up of its middle."""
    place, _ = camera.rays(np.zeros(1, np.float32), np.zeros(1, np.float32), (2, 2))
    right, up, back = camera.axes
    offset = points - place
    return np.stack([offset @ right, offset @ up], axis=1) / -(offset @ back)[:, None]
