"""Rays against triangles: a thin typed face over Embree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import PluginError
from guard_api.viewer.surfaces import Surface

Float = NDArray[np.floating]
Mask = NDArray[np.bool_]

FAR = 1e9
"""Distance at which nothing was hit [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hits:
    """What rays met first: at `distance` (P,) [m], `FAR` for nothing; `face` (P,), -1 for none; `normal` (P, 3)."""

    distance: Float
    face: NDArray[np.int32]
    normal: Float


class Tracer:
    """Answers what rays meet on a `surface`. Raises PluginError when Embree is not installed."""

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self._scene = _embree_scene(surface) if len(surface.faces) else None

    def first(self, origin: Float, direction: Float) -> Hits:
        """Return what rays from `origin` (P, 3) along the unit `direction` (P, 3) meet first; smooth normals."""
        count = len(direction)
        hits = Hits(
            distance=np.full(count, FAR, np.float32),
            face=np.full(count, -1, np.int32),
            normal=np.zeros((count, 3), np.float32),
        )
        if self._scene is None or count == 0:
            return hits
        found = self._scene.run(origin, direction, query="INTERSECT", output=True)
        met = np.flatnonzero(found["primID"] >= 0)
        face = found["primID"][met]
        corners = self._surface.normals[self._surface.faces[face]]
        u, v = found["u"][met, None], found["v"][met, None]
        hits.distance[met], hits.face[met] = found["tfar"][met], face
        hits.normal[met] = unit((1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2])
        return hits

    def blocked(self, origin: Float, direction: Float, reach: float) -> Mask:
        """Return which rays (P,) from `origin` (P, 3) along `direction` (P, 3) meet anything within `reach` [m]."""
        if self._scene is None or len(origin) == 0:
            return np.zeros(len(origin), bool)
        distance = np.full(len(origin), reach, np.float32)
        return self._scene.run(origin, direction, distance, query="OCCLUDED") >= 0


def unit(vectors: Float) -> Float:
    """Return `vectors` (P, 3) at length 1."""
    return vectors / np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]


def _embree_scene(surface: Surface) -> Any:
    try:
        from embreex.mesh_construction import TriangleMesh  # noqa: PLC0415  an optional extra
        from embreex.rtcore_scene import EmbreeScene  # noqa: PLC0415
    except ImportError as error:
        raise PluginError("pictures need the package 'embreex': pip install 'guard-api[render]'") from error
    scene: Any = EmbreeScene()
    build: Callable[..., Any] = TriangleMesh
    build(scene, surface.vertices, surface.faces)
    return scene
