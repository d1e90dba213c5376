"""MuJoCo's warnings go to Python's logging, not to MUJOCO_LOG.TXT in whatever directory the user works in."""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import logging

import mujoco

logger = logging.getLogger("guard_mujoco")


def redirect_warnings() -> None:
    """Send the engine's warnings to the logger `guard_mujoco`, unless somebody else already takes them."""
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log)


def _log(message: str) -> None:
    # Every world that diverges says so; its state and `ok` tell the user, so this is for debugging only.
    logger.debug("%s", message)
