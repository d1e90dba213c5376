"""What all tests share: which backends are installed."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

from guard_api import plugins

BACKENDS = plugins.available("guard.backends")

# Properties are tried on other examples every time: few at `make test`, many at `make slow`. Nothing waits on a clock.
settings.register_profile("fast", max_examples=25, deadline=None)
settings.register_profile("thorough", max_examples=500, deadline=None)
settings.load_profile("fast")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let `pytest -m slow tests/env/test_suite.py` leave a table, and go on where it was stopped."""
    parser.addoption("--suite-table", type=Path, metavar="FILE", help="JSON lines of the environments that hold")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for `backend_name` once per installed backend; an absent engine is a visible skip."""
    if "backend_name" in metafunc.fixturenames:
        params = [
            pytest.param(name, marks=[pytest.mark.skip(reason=reason)] if reason else [])
            for name, reason in BACKENDS.items()
        ]
        metafunc.parametrize("backend_name", params)
