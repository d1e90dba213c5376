"""A third party's backend is found, loaded, stepped and refused without any change to GUARD."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from guard_api import plugins
from guard_api.errors import PluginError, SpecError
from guard_api.physics.backend import Backend, World
from guard_api.physics.build import build_world
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start
from guard_api.testing import robots

DISTRIBUTION = Path(__file__).parent / "dummy_distribution"


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The distribution on the path, as an installer would leave it: package and entry points."""
    monkeypatch.syspath_prepend(str(DISTRIBUTION))


def test_the_distribution_declares_what_its_metadata_say() -> None:
    """An installer would write these entry points from the dummy's own project file."""
    project = tomllib.loads((DISTRIBUTION / "pyproject.toml").read_text())["project"]
    entries = (DISTRIBUTION / "guard_dummy-1.0.dist-info/entry_points.txt").read_text()
    for name, value in project["entry-points"]["guard.backends"].items():
        assert f"{name} = {value}\n" in entries


def test_listing_finds_it_and_imports_nothing() -> None:
    code = (
        f"import sys; sys.path.insert(0, {str(DISTRIBUTION)!r}); from guard_api import plugins; "
        "assert 'dummy' in plugins.names('guard.backends'); "
        "assert not {'guard_dummy', 'mujoco', 'pybullet', 'sapien', 'torch'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("workers", [1, 2])
def test_it_steps(workers: int) -> None:
    backend = plugins.load("guard.backends", "dummy")
    assert isinstance(backend, Backend)
    scene = SceneSpec(robot=robots.pendulum())
    world = build_world(backend, scene, 4, workers)
    try:
        assert isinstance(world, World)
        world.reset(np.ones(4, bool), home_start(scene, 4))
        world.step(np.full((4, 1), 0.5), 10)
        state = world.state()
        assert world.approximations == ("made for tests",)
        assert (state.joint_position > 0.0).all()
        np.testing.assert_allclose(state.time, 0.02)
    finally:
        world.close()


def test_another_api_is_refused() -> None:
    with pytest.raises(PluginError, match="written for backend API 999, this GUARD has 1"):
        plugins.load("guard.backends", "dummy-from-the-future")


def test_a_missing_engine_names_the_extra() -> None:
    with pytest.raises(PluginError, match=r"needs the package 'pybullet': pip install 'guard-api\[bullet\]'"):
        plugins.load("guard.backends", "dummy-without-its-engine")


def test_a_name_that_its_package_lacks_is_told() -> None:
    with pytest.raises(PluginError, match="guard_dummy:bakend, which does not exist"):
        plugins.load("guard.backends", "dummy-with-a-typo")


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(SpecError, match=r"unknown backend 'dumy': did you mean dummy\b"):
        plugins.load("guard.backends", "dumy")


def test_availability_gives_every_reason_at_once() -> None:
    available = plugins.available("guard.backends")
    assert available["dummy"] is None
    reasons = [available[f"dummy-{why}"] for why in ("from-the-future", "without-its-engine", "with-a-typo")]
    assert all(reason and "\n" not in reason for reason in reasons)
