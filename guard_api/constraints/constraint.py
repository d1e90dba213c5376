"""The protocol of a constraint: what it places, what it costs, how it is observed."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.spec import BodyGroup


@runtime_checkable
class Constraint(Protocol):
    """A constraint is a frozen dataclass of its parameters; all methods are pure and batched over N worlds."""

    @property
    def name(self) -> str:
        """Name of its cost column."""
        ...

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the body groups that the constraint needs, placed in this order."""
        ...

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return where objects that move by themselves are `duration` [s] later: group -> (N, count, 3) [m]."""
        ...

    def cost(self, t: Transition) -> Array:
        """Return the graded cost of a step: (N,) >= 0, never clipped."""
        ...

    def indicator(self, t: Transition) -> NDArray[np.bool_]:
        """Return whether the step violates the constraint: (N,)."""
        ...

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return the constraint's readings by name, each (N, k)."""
        ...
