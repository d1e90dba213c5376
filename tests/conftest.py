"""What all tests share: which backends are installed, one thread for linear algebra, how many examples are tried."""

from __future__ import annotations

import os
from pathlib import Path

# Read when NumPy and PyTorch are first imported. Threads that wait in a loop for each other's shares of tiny matrices
# take ten times the time of the arithmetic, and more where two processes of tests share two cores.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

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
