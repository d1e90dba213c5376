"""The `ideal` backend: exact multi-body dynamics without contacts, in NumPy alone."""

from guard_api.testing.ideal.world import IdealBackend

backend = IdealBackend()
"""What the entry point `ideal` of group `guard.backends` names."""
