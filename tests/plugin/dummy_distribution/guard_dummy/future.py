"""A backend written for a contract that this GUARD does not have."""

from guard_dummy import DummyBackend


class FutureBackend(DummyBackend):
    name = "dummy-from-the-future"
    api_version = 999


backend = FutureBackend()
