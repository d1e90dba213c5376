"""Constraints, one file each; `CONSTRAINTS` is the table that names them."""

from __future__ import annotations

from typing import Final

from guard_api.constraints.constraint import Constraint
from guard_api.constraints.hazards import Hazards

CONSTRAINTS: Final[dict[str, type]] = {"Hazards": Hazards}
"""Name in an environment id -> constraint dataclass."""

__all__ = ["CONSTRAINTS", "Constraint", "Hazards"]
