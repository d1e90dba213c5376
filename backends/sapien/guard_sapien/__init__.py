"""SAPIEN (PhysX 5, CPU) as a GUARD backend: `backend` is the plugin object."""

from __future__ import annotations

from guard_api.conventions import BACKEND_API
from guard_api.physics.backend import Capabilities
from guard_api.scene.spec import SceneSpec
from guard_sapien.engine import physx, sapien
from guard_sapien.world import SapienWorld

_ROUNDS_POSES = (
    "PhysX rounds a pose in float32 every time it is set, so a restored run starts up to one rounding unit beside the "
    "uninterrupted one; all runs restored from one snapshot repeat each other bit for bit"
)
_HIDES_FREE_BASE = (
    "SAPIEN's dynamics queries leave out the base: for a floating base neither mass matrix nor bias force can be asked "
    "for"
)
_SPRINGY_STOPS = (
    "PhysX's joint stops are springs where armature outweighs the links of a light, floating robot a thousandfold "
    "(Ant): its solver takes several timesteps to stop such a joint and lets it keep the speed back; more iterations "
    "do not help"
)
GAPS = {
    "stops_hold": _SPRINGY_STOPS,
    "floating_mass_matrix": _HIDES_FREE_BASE,
    "floating_bias_force": _HIDES_FREE_BASE,
    "restore_repeats": _ROUNDS_POSES,
    "restore_repeats_in_contact": _ROUNDS_POSES,
}
"""Conformance checks that PhysX cannot pass, and why; every other one passes."""


class SapienBackend:
    """The plugin: see `guard_api.physics.backend.Backend`."""

    name = "sapien"
    api_version = BACKEND_API
    capabilities = Capabilities(precision="float32", exact_snapshot=False, gaps=GAPS)

    def versions(self) -> dict[str, str]:
        """Return the versions of SAPIEN and of the PhysX inside it."""
        return {"sapien": str(sapien.__version__), "physx": physx.version()}

    def build(self, scene: SceneSpec, num_worlds: int, threads: int = 1) -> SapienWorld:
        """Build `num_worlds` copies of `scene`; `threads` is ignored, since PhysX's step holds Python's lock."""
        return SapienWorld(scene, num_worlds)


backend = SapienBackend()
