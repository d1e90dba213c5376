"""Tasks, one file each; `TASKS` is the table that names them."""

from __future__ import annotations

from typing import Final

from guard_api.tasks.button import Button
from guard_api.tasks.chase import Chase
from guard_api.tasks.circle import Circle
from guard_api.tasks.defense import Defense
from guard_api.tasks.goal import Goal
from guard_api.tasks.push import Push
from guard_api.tasks.task import Task

TASKS: Final[dict[str, type]] = {task.__name__: task for task in (Goal, Push, Chase, Defense, Button, Circle)}
"""Name in an environment id -> task dataclass."""

__all__ = ["TASKS", "Button", "Chase", "Circle", "Defense", "Goal", "Push", "Task"]
