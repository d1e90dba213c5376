"""The one place that imports SAPIEN, without its display, and opens empty PhysX scenes."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

with warnings.catch_warnings():
    # Importing SAPIEN looks for a Vulkan loader, which only rendering needs; GUARD never renders with SAPIEN.
    warnings.filterwarnings("ignore", message="Failed to find", category=UserWarning)
    import sapien
    from sapien import physx

from guard_api.scene.spec import SceneSpec

SAPIEN_BOUNCE_THRESHOLD = 2.0
"""PhysX's default approach speed below which nothing bounces [m/s]; kept by the preset "native"."""


def open_scene(spec: SceneSpec) -> sapien.Scene:
    """Return an empty scene with the gravity, timestep and solver of `spec`, and no renderer.

    `sapien.Scene()` without arguments opens a renderer and crashes the process where there is none, so the physics
    system is always built first. Its configuration is global to the process and is replaced as a whole by each call.
    """
    physx.set_scene_config(
        gravity=np.asarray(spec.gravity, np.float32),  # type: ignore[arg-type]  # the hint wants a fixed shape,
        bounce_threshold=bounce_threshold(spec),
        enable_pcm=True,
        enable_tgs=True,
        enable_ccd=False,
        enable_enhanced_determinism=True,
        enable_friction_every_iteration=True,
        cpu_workers=0,
    )
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.timestep = spec.timestep
    return scene


def bounce_threshold(spec: SceneSpec) -> float:
    """Return the approach speed below which contacts do not bounce [m/s].

    Twice the speed that gravity adds in one timestep: a resting body always stays below it, a bouncing one above it.
    """
    if spec.preset == "native":
        return SAPIEN_BOUNCE_THRESHOLD
    return max(1e-3, 2.0 * float(np.linalg.norm(spec.gravity)) * spec.timestep)


def pose(position: ArrayLike, quaternion: ArrayLike) -> sapien.Pose:
    """Return SAPIEN's pose of a position (3,) [m] and quaternion (w, x, y, z)."""
    return sapien.Pose(p=np.asarray(position, float).tolist(), q=np.asarray(quaternion, float).tolist())
