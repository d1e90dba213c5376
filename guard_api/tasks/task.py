"""The protocol of a task: what it places, pays, observes and counts as success."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from guard_api.physics.transition import Array, Snapshot, Transition
from guard_api.scene.spec import BodyGroup


@runtime_checkable
class Task(Protocol):
    """A task is a frozen dataclass of its parameters; all methods are pure and batched over N worlds."""

    @property
    def bonus(self) -> float:
        """Reward that is added in a step in which the task was `reached`."""
        ...

    def objects(self) -> tuple[BodyGroup, ...]:
        """Return the body groups that the task needs, placed in this order."""
        ...

    def move(self, now: Snapshot, duration: float) -> dict[str, Array]:
        """Return where objects that move by themselves are `duration` [s] later: group -> (N, count, 3) [m]."""
        ...

    def reward(self, t: Transition) -> Array:
        """Return the reward of a step: (N,), without the bonus; a new array, which the environment may change."""
        ...

    def reached(self, t: Transition) -> NDArray[np.bool_]:
        """Return which worlds achieved the task in this step: (N,)."""
        ...

    def respawn(self) -> str | None:
        """Return the group that gets a new place in a world that `reached`, or None."""
        ...

    def observe(self, t: Transition) -> dict[str, Array]:
        """Return the task's own readings by name, each (N, k)."""
        ...
