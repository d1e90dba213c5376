"""The backends that tests run on."""

from __future__ import annotations

import pytest

from guard_api import plugins
from guard_api.errors import PluginError
from guard_api.physics.backend import Backend


def engine(name: str) -> Backend:
    """Return the backend, or skip the test where its engine is not installed; a plugin that fails to load raises."""
    try:
        return plugins.load("guard.backends", name)
    except PluginError as problem:
        if "pip install" not in str(problem):
            raise
        pytest.skip(str(problem))
