"""All worlds of one `SapienWorld` in the engine: which scene each lives in, and their packed state.

Worlds in which nothing can ever touch anything share scenes, which halves the cost of a step: their articulations lie
at the same place, without shapes, and PhysX moves each as if it were alone. All others have a scene of their own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.state import Array
from guard_api.scene.spec import SceneSpec
from guard_sapien.compile import Copy, compile_scene, touches
from guard_sapien.packed import PackedLayout
from guard_sapien.surfaces import ContactTable

WORLDS_PER_SCENE = 16
"""Worlds in a shared scene: more than 16 no longer fit the cache of a core and get slower again."""


class Fleet:
    """N worlds: `copies` (N,), and their packed state, which is read once after each change.

    A world that is retired keeps the packed state that it had, whatever its articulation does from then on.
    """

    def __init__(self, spec: SceneSpec, num_worlds: int, table: ContactTable) -> None:
        self._spec, self._table = spec, table
        self.shared = not touches(spec)
        size = WORLDS_PER_SCENE if self.shared else 1
        self.copies: list[Copy] = []
        for first in range(0, num_worlds, size):
            self.copies += compile_scene(spec, table, min(size, num_worlds - first))
        self.layout = PackedLayout(spec)
        self._packed = self.layout.read(self.copies)
        self._stale = np.zeros(num_worlds, bool)

    def read(self) -> Array:
        """Return the packed state of all worlds: (N, width); not to be written to."""
        if self._stale.any():
            fresh = self.layout.read(self.copies)
            self._packed = np.where(self._stale[:, None], fresh, self._packed)
            self._stale[:] = False
        return self._packed

    def changed(self, worlds: Sequence[int] | NDArray[np.intp]) -> None:
        """Say that the engine's state of `worlds` has changed."""
        self._stale[worlds] = True

    def retire(self, worlds: NDArray[np.intp]) -> None:
        """Put the articulations of `worlds` to rest, if others share their scene; their packed state stays."""
        self.read()
        for copy in (self.copies[world] for world in worlds if self.shared):
            if copy.robot is not None:
                copy.robot.come_to_rest()

    def renew(self, worlds: NDArray[np.intp]) -> list[int]:
        """Build those of `worlds` anew whose numbers became non-finite and that have a scene of their own.

        What PhysX caches of contacts may be poisoned; worlds in shared scenes have none. Returns the worlds rebuilt.
        """
        broken = worlds[~np.isfinite(self.read()[worlds]).all(axis=1)] if not self.shared else worlds[:0]
        for world in broken:
            (self.copies[world],) = compile_scene(self._spec, self._table, 1)
        self.changed(broken)
        return broken.tolist()

    def write(self, packed: NDArray[np.float32], ok: NDArray[np.bool_]) -> None:
        """Put the worlds that are `ok` into `packed` (N, width); the others only report it."""
        rows = self.layout.read(self.copies).astype(np.float32)
        rows[ok] = packed[ok]
        first = 0
        for system, count in self.layout.systems(self.copies):
            system.unpack(rows[first : first + count].tobytes())
            first += count
        self._packed = packed.astype(float)
        self._stale = ok.copy()
