"""GUARD's MuJoCo plugin: `backend` is what the entry point `guard.backends: mujoco` names."""

from guard_mujoco.backend import MuJoCoBackend, backend

__all__ = ["MuJoCoBackend", "backend"]
