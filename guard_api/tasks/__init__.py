"""Tasks, one file each; `TASKS` is the table that names them."""

from __future__ import annotations

from typing import Final

from guard_api.tasks.goal import Goal
from guard_api.tasks.task import Task

TASKS: Final[dict[str, type]] = {"Goal": Goal}
"""Name in an environment id -> task dataclass."""

__all__ = ["TASKS", "Goal", "Task"]
