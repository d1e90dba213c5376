"""What all tests share: which backends are installed."""

from __future__ import annotations

import pytest

from guard_api import plugins

BACKENDS = plugins.available("guard.backends")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for `backend_name` once per installed backend; an absent engine is a visible skip."""
    if "backend_name" in metafunc.fixturenames:
        params = [
            pytest.param(name, marks=[pytest.mark.skip(reason=reason)] if reason else [])
            for name, reason in BACKENDS.items()
        ]
        metafunc.parametrize("backend_name", params)
