"""GUARD's PyBullet plugin: `backend` is what the entry point `guard.backends: bullet` names."""

from guard_bullet.backend import BulletBackend, backend

__all__ = ["BulletBackend", "backend"]
