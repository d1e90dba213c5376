"""The manifest says what decided the numbers."""

from __future__ import annotations

import json
from datetime import datetime
from importlib import metadata

import pytest

from guard_api.errors import PluginError
from guard_api.physics.backend import Capabilities
from guard_api.runs.manifest import asset_hashes, build_manifest, git_state, package_versions
from guard_api.spec import EnvSpec
from guard_api.tasks import TASKS

SPEC = EnvSpec(name="Goal_Point_0Hazards", robot="point", task=TASKS["Goal"](), constraints=())


class Engine:
    name = "engine"
    api_version = 1
    capabilities = Capabilities()

    def versions(self):
        return {"engine": "9.9"}

    def build(self, scene, num_worlds, threads=1):
        raise AssertionError("a manifest builds nothing")


def test_manifest_holds_every_decider():
    manifest = build_manifest(env_spec=SPEC, backend=Engine(), algorithm="cpo", seed=3, num_worlds=8, total_steps=1000)
    assert json.loads(json.dumps(manifest)) == manifest
    assert manifest["versions"].items() >= {"engine": "9.9"}.items()
    assert {"guard", "python", "numpy"} <= manifest["versions"].keys()
    assert (manifest["spec_fingerprint"], manifest["seed"], manifest["backend"]) == (SPEC.fingerprint, 3, "engine")
    assert datetime.fromisoformat(manifest["started"]).utcoffset() is not None
    assert manifest["hardware"]["cores"] >= 1


def test_git_state_outside_a_checkout_is_none(tmp_path):
    assert git_state(tmp_path) is None


def test_assets_are_the_files_of_the_robots_own_folder(tmp_path, monkeypatch):
    for robot in ("rover", "beetle"):
        (tmp_path / "urdf" / robot / "meshes").mkdir(parents=True)
        for file in (f"{robot}.urdf", "meshes/wheel.obj"):
            (tmp_path / "urdf" / robot / file).write_text(robot)
    monkeypatch.setattr("guard_api.plugins.names", lambda group: ["mine"])
    monkeypatch.setattr("guard_api.plugins.load", lambda group, name: lambda: tmp_path)
    before = asset_hashes("rover")
    assert list(before) == ["meshes/wheel.obj", "rover.urdf"]
    (tmp_path / "urdf/rover/meshes/wheel.obj").write_text("edited")
    changed = {file for file, digest in asset_hashes("rover").items() if digest != before[file]}
    assert changed == {"meshes/wheel.obj"}


def test_a_robot_package_that_does_not_import_is_said(monkeypatch):
    def broken(group, name):
        raise PluginError("mine cannot be imported")

    monkeypatch.setattr("guard_api.plugins.names", lambda group: ["mine"])
    monkeypatch.setattr("guard_api.plugins.load", broken)
    with pytest.raises(PluginError, match="mine"):
        asset_hashes("point")


@pytest.mark.parametrize("package", ["torch", "numba"])
def test_optional_packages_are_named_where_they_are_installed(monkeypatch, package):
    def installed(name):
        if name != package:
            raise metadata.PackageNotFoundError(name)
        return "9.9"

    monkeypatch.setattr(metadata, "version", installed)
    assert package_versions()[package] == "9.9"

    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", missing)
    assert package not in package_versions()
