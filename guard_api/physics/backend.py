"""The seam between GUARD and a simulator: a `Backend` builds a `World` from a scene.

Clauses C1-C12 are tested by `guard_api.testing.conformance`; a plugin is done when `guard conform --backend NAME`
passes. Nothing here knows a simulator.

A plugin is found through the entry-point group `guard.backends` (`guard_api.plugins`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.state import Array, Inspection, Mask, Start, State
from guard_api.scene.spec import SceneSpec

CLOSED: Final = "this world is closed: build another one"
"""What the BackendError of a closed world says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capabilities:
    """What an engine can do, declared, so that nothing is skipped silently.

    threads: whether `build(threads=n)` steps worlds in parallel inside one process; otherwise worlds are sharded
    over processes (`guard_api.physics.shard`).
    precision: "float64" or "float32", the arithmetic of the engine.
    exact_snapshot: whether a run continued after `restore` repeats the uninterrupted run bit for bit.
    contacts: whether bodies and robots touch at all (False for the contact-free `ideal` backend).
    gaps: conformance clause or check -> the reason why this engine cannot meet it.
    """

    threads: bool = False
    precision: str = "float64"
    exact_snapshot: bool = True
    contacts: bool = True
    gaps: Mapping[str, str] = field(default_factory=dict)


@runtime_checkable
class World(Protocol):
    """N independent copies of a scene. World i behaves the same whatever N is and whatever the others do.

    Once closed, everything but `drive` and `close` raises BackendError with the message `CLOSED`.

    approximations: what of the scene this engine could not express exactly, one sentence each.
    """

    scene: SceneSpec
    num_worlds: int
    approximations: tuple[str, ...]

    def reset(self, mask: Mask, start: Start) -> None:
        """Start the worlds where `mask` (N,) is true from the rows of `start`; the others keep every bit."""
        ...

    def step(self, control: NDArray[np.floating], substeps: int) -> None:
        """Advance all worlds by exactly `substeps` timesteps under `control` (N, U), held constant.

        The actuation law of `guard_api.physics.actuation` is evaluated at every substep; it clips controls to their
        ranges. A world whose row of `control` is not finite, NaN or infinite, fails: it is not `ok` from then on.
        Worlds that are not `ok` stay as they are; all may be so at once.
        """
        ...

    def drive(self, group: str, position: Array, quaternion: Array) -> None:
        """Send the driven bodies of `group` to `position` (N, count, 3), `quaternion` (N, count, 4).

        They arrive at the end of the next `step`, moving at constant velocity, which they pass on to what they push.
        """
        ...

    def state(self) -> State:
        """Return the present state; valid right after `reset` and after `step`. Reading changes nothing."""
        ...

    def snapshot(self) -> bytes:
        """Return all worlds' states as bytes that `restore` of an equal world understands."""
        ...

    def restore(self, blob: bytes) -> None:
        """Return to a snapshot. Raises BackendError when it is not one of an equal world."""
        ...

    def inspect(self, world: int) -> Inspection:
        """Return what the engine holds for one world; slow, for checks only."""
        ...

    def step_raw(self, substeps: int) -> None:
        """Run the bare engine, actuation law included, for `substeps` under the last control, reading nothing back.

        The denominator of the efficiency that `guard bench` reports.
        """
        ...

    def close(self) -> None:
        """Release engine, processes and memory; calling it twice is allowed."""
        ...


@runtime_checkable
class Backend(Protocol):
    """A simulator plugin. `name` is its flag; `api_version` the `BACKEND_API` it was written for.

    versions: engine package -> version, for manifests.
    """

    name: str
    api_version: int
    capabilities: Capabilities

    def versions(self) -> dict[str, str]:
        """Return the version of every package that decides this engine's numbers."""
        ...

    def build(self, scene: SceneSpec, num_worlds: int, threads: int = 1) -> World:
        """Build `num_worlds` copies of `scene`. Raises BackendError for what the engine cannot build at all."""
        ...
