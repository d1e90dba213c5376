"""Constraints, one file each; `CONSTRAINTS` is the table that names them."""

from __future__ import annotations

from typing import Final

from guard_api.constraints.buttons import Buttons
from guard_api.constraints.constraint import Constraint
from guard_api.constraints.ghosts import Ghosts
from guard_api.constraints.gremlins import Gremlins
from guard_api.constraints.hazards import Hazards
from guard_api.constraints.pillars import Pillars
from guard_api.constraints.vases import Vases
from guard_api.constraints.walls import Walls

_ALL: Final[tuple[type, ...]] = (Hazards, Ghosts, Vases, Pillars, Buttons, Gremlins, Walls)

CONSTRAINTS: Final[dict[str, type]] = {constraint.__name__: constraint for constraint in _ALL}
"""Name in an environment id -> constraint dataclass."""

__all__ = [
    "CONSTRAINTS", "Buttons", "Constraint", "Ghosts", "Gremlins", "Hazards", "Pillars", "Vases", "Walls",
]  # fmt: skip
