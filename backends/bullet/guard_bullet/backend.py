"""The plugin's face: what this engine is, can do and cannot do."""

from __future__ import annotations

from importlib.metadata import version

from guard_api.conventions import BACKEND_API
from guard_api.physics.backend import Capabilities
from guard_api.scene.spec import SceneSpec
from guard_bullet.world import BulletWorld


class BulletBackend:
    """Bullet through PyBullet: one engine instance per world, all in this process."""

    name = "bullet"
    api_version = BACKEND_API
    capabilities = Capabilities(threads=False, precision="float64")

    def versions(self) -> dict[str, str]:
        """Return the versions of PyBullet and of NumPy, which evaluates the actuation law."""
        return {name: version(name) for name in ("pybullet", "numpy")}

    def build(self, scene: SceneSpec, num_worlds: int, threads: int = 1) -> BulletWorld:
        """Build `num_worlds` engine instances of `scene`; `threads` is not used, since the engine holds Python's lock.

        Raises BackendError for what Bullet cannot build.
        """
        del threads
        return BulletWorld(scene, num_worlds)


backend = BulletBackend()
