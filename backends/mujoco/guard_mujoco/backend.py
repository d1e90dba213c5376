"""The plugin itself: what this engine can do, and how a scene becomes a world."""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco

from guard_api.conventions import BACKEND_API
from guard_api.errors import BackendError
from guard_api.physics.backend import Capabilities
from guard_api.scene.spec import SceneSpec
from guard_mujoco.compile import compile_scene
from guard_mujoco.world import MuJoCoWorld


class MuJoCoBackend:
    """MuJoCo 4 through its batch module: N worlds of one model, stepped on a thread pool inside the engine."""

    name = "mujoco"
    api_version = BACKEND_API
    capabilities = Capabilities(threads=True, precision="float64", exact_snapshot=True)

    def versions(self) -> dict[str, str]:
        """Return the engine's version."""
        return {"mujoco-core": mujoco.mj_versionString()}

    def build(self, scene: SceneSpec, num_worlds: int, threads: int = 1) -> MuJoCoWorld:
        """Build `num_worlds` copies of `scene`. Raises BackendError for what MuJoCo cannot build."""
        if num_worlds < 1 or threads < 1:
            raise BackendError(f"num_worlds={num_worlds}, threads={threads}: both must be at least 1")
        return MuJoCoWorld(compile_scene(scene), num_worlds, threads)


backend = MuJoCoBackend()
