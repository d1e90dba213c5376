"""The manifest says what decided the numbers."""

from __future__ import annotations

import json
from datetime import datetime

from guard_api.physics.backend import Capabilities
from guard_api.runs.manifest import asset_hashes, build_manifest, git_state
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


def test_assets_of_other_robots_are_not_listed(tmp_path, monkeypatch):
    for robot in ("point", "ant"):
        (tmp_path / "urdf" / robot).mkdir(parents=True)
        (tmp_path / "urdf" / robot / f"{robot}.urdf").write_text(robot)
    monkeypatch.setattr("guard_api.plugins.names", lambda group: ["shipped"])
    monkeypatch.setattr("guard_api.plugins.load", lambda group, name: lambda: tmp_path)
    hashes = asset_hashes("Point")
    assert list(hashes) == ["shipped/urdf/point/point.urdf"]
