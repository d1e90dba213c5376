"""Triangles of the neutral shapes, with the normals that make round things look round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from guard_api.viewer.parts import Part

Float = NDArray[np.floating]

AROUND = 64
"""Corners of the circle that stands for a round section: a flaw of 0.1 % of the radius."""

CREASE = np.radians(20.0)
"""Angle between faces of a mesh from which their common edge is shown sharp."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """A triangle mesh of K convex pieces.

    vertices: (V, 3) [m]. normals: (V, 3) unit, outwards. faces: (F, 3) vertex numbers. starts: (K,) first vertex of
    each piece. owner: (F,) the piece that a face belongs to.
    """

    vertices: Float
    normals: Float
    faces: NDArray[np.int32]
    starts: NDArray[np.intp]
    owner: NDArray[np.intp]


def joined(parts: Sequence[Part]) -> Surface:
    """Return all `parts` as one surface in world axes, a piece each, in their order."""
    own = [surface(part.shape) for part in parts]
    turn = [rotations.to_matrix(part.quaternion).T for part in parts]
    placed = [s.vertices @ R + part.position for s, R, part in zip(own, turn, parts, strict=True)]
    turned = [s.normals @ R for s, R in zip(own, turn, strict=True)]
    starts = np.cumsum([0, *(len(s.vertices) for s in own)], dtype=np.intp)[:-1]
    faces = [s.faces + first for s, first in zip(own, starts, strict=True)]
    return Surface(
        vertices=np.concatenate([np.empty((0, 3)), *placed]).astype(np.float32),
        normals=np.concatenate([np.empty((0, 3)), *turned]).astype(np.float32),
        faces=np.concatenate([np.empty((0, 3)), *faces]).astype(np.int32),
        starts=starts,
        owner=np.repeat(np.arange(len(parts)), [len(s.faces) for s in own]),
    )


@lru_cache(maxsize=512)
def surface(shape: Shape) -> Surface:
    """Return `shape` as triangles in its own axes."""
    match shape:
        case Sphere(radius=radius):
            return _revolved([_arc(radius, 0.0, -0.5 * np.pi, 0.5 * np.pi)])
        case Capsule(radius=radius, half_length=half):
            lower, upper = _arc(radius, -half, -0.5 * np.pi, 0.0), _arc(radius, half, 0.0, 0.5 * np.pi)
            return _revolved([np.concatenate([lower, upper])])
        case Cylinder(radius=radius, half_length=half):
            bottom = [[0.0, -half, 0.0, -1.0], [radius, -half, 0.0, -1.0]]
            side = [[radius, -half, 1.0, 0.0], [radius, half, 1.0, 0.0]]
            top = [[radius, half, 0.0, 1.0], [0.0, half, 0.0, 1.0]]
            return _revolved([np.array(bottom), np.array(side), np.array(top)])
        case Box(half_extents=half):
            corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij")).reshape(3, -1).T * half
            return _hull(corners)
        case Mesh(vertices=corners):
            return _hull(np.array(corners))


def _arc(radius: float, centre: float, start: float, end: float) -> NDArray[np.float64]:
    """Return a meridian from latitude `start` to `end`: rows (distance from the axis, z, normal outwards, normal z)."""
    angle = np.linspace(start, end, 2 + round(AROUND / (2 * np.pi) * (end - start)))
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([radius * c, centre + radius * s, c, s], axis=1)


def _revolved(profiles: Sequence[NDArray[np.float64]]) -> Surface:
    """Return the surface that the `profiles`, rows as of `_arc` from bottom to top, sweep about z; each is smooth."""
    turn = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    c, s = np.cos(turn), np.sin(turn)
    vertices, normals, faces = [], [], []
    first = 0
    for rows in profiles:
        r, z, nr, nz = (column[:, None] for column in rows.T)
        vertices.append(np.stack([r * c, r * s, z + 0 * c], axis=-1).reshape(-1, 3))
        normals.append(np.stack([nr * c, nr * s, nz + 0 * c], axis=-1).reshape(-1, 3))
        row, column = np.mgrid[0 : len(rows) - 1, 0:AROUND]
        here, beside = first + row * AROUND + column, first + row * AROUND + (column + 1) % AROUND
        above, across = here + AROUND, beside + AROUND
        faces += [
            np.stack([here, beside, across], -1).reshape(-1, 3),
            np.stack([here, across, above], -1).reshape(-1, 3),
        ]
        first += rows.shape[0] * AROUND
    return _single(np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces))


def _hull(corners: NDArray[np.float64]) -> Surface:
    """Return the convex hull of `corners` (V, 3), sharp where its faces meet at more than `CREASE`."""
    import trimesh  # noqa: PLC0415  takes a second to import, needed for pictures only

    hull = trimesh.Trimesh(vertices=corners, process=False).convex_hull
    smooth = hull.face_adjacency[hull.face_adjacency_angles < CREASE]
    groups = trimesh.graph.connected_components(smooth, nodes=np.arange(len(hull.faces)), min_len=1)
    vertices, normals, faces = [], [], []
    first = 0
    for group in groups:
        piece = hull.submesh([group], append=True, repair=False)
        assert isinstance(piece, trimesh.Trimesh)
        vertices.append(piece.vertices)
        normals.append(piece.vertex_normals)
        faces.append(piece.faces + first)
        first += len(piece.vertices)
    return _single(np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces))


def _single(vertices: NDArray[np.float64], normals: NDArray[np.float64], faces: NDArray[np.integer]) -> Surface:
    return Surface(
        vertices=vertices.astype(np.float32),
        normals=normals.astype(np.float32),
        faces=faces.astype(np.int32),
        starts=np.zeros(1, np.intp),
        owner=np.zeros(len(faces), np.intp),
    )
