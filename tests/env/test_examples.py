"""The examples beside `own_task.py`: specification files, and a robot that a package brings."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from guard_api.cli.main import run
from guard_api.env import make_environment
from guard_api.runs.manifest import asset_hashes
from guard_api.spec import EnvSpec
from guard_api.suite import known_names, make_spec

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.toml")), ids=lambda file: file.stem)
def test_a_specification_file_makes_an_environment(file: Path) -> None:
    env = make_environment(str(file), backend="ideal", num_worlds=2)
    assert env.spec.name == file.stem
    step = env.step(np.zeros((2, env.action_size)))
    assert np.isfinite(step.observation).all()
    env.close()


def test_solid_ghosts_are_solid() -> None:
    for name in ("solid_ghosts", "solid_ghosts_in_space"):
        env = make_environment(str(EXAMPLES / f"{name}.toml"), backend="ideal")
        assert {group.name: group.body.physics for group in env.groups}["ghosts"] == "driven"
        env.close()


@pytest.fixture
def tug(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example's robot as what an installed package offers."""
    info = tmp_path / "own_robot-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-robot\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[guard.robots]\nown = own_robot:robots\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.syspath_prepend(str(EXAMPLES / "own_robot"))
    monkeypatch.delitem(sys.modules, "own_robot", raising=False)


@pytest.mark.usefixtures("tug")
def test_a_robot_of_a_package_is_a_name_and_drives(backend_name: str) -> None:
    """At full thrust it reaches its 1 m/s: after 4 s the speed is within exp(-8) of it."""
    assert {"Goal_Tug_8Hazards", "Push_Tug_8Ghosts"} <= set(known_names())
    env = make_environment("Goal_Tug_8Hazards", backend=backend_name)
    env.reset()
    for _ in range(200):
        observation = env.step(np.array([[1.0, 0.0]])).observation
    assert observation[0, env.observation_layout["velocimeter"]] == pytest.approx([1.0, 0.0, 0.0], abs=2e-3)
    env.close()


@pytest.mark.usefixtures("tug")
def test_a_robot_of_a_package_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["list", "robots", "--json"]) == 0
    assert '"tug"' in capsys.readouterr().out
    assert run(["list", "envs", "--robot", "tug"]) == 0
    assert "Chase_Tug_8Hazards" in capsys.readouterr().out


def test_a_robot_is_called_by_its_path_from_the_specification(tmp_path: Path) -> None:
    """The path is taken from beside the specification; a manifest records its files and meshes alone."""
    folder = tmp_path / "robots"
    shutil.copytree(EXAMPLES / "own_robot" / "robots" / "urdf" / "tug", folder / "tug")
    urdf = folder / "tug" / "tug.urdf"
    corner = "<collision><geometry><mesh filename='corner.obj'/></geometry></collision>"
    urdf.write_text(urdf.read_text().replace("</inertial>", f"</inertial>{corner}", 1))
    points = "\n".join(f"v {x} {y} {z}" for x, y, z in ((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))
    (folder / "tug" / "corner.obj").write_text(points + "\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    (folder / "unrelated.bin").write_bytes(b"large")
    (tmp_path / "own.toml").write_text('robot = "robots/tug/tug.urdf"\n[task]\ntype = "Goal"\n')
    spec = make_spec(str(tmp_path / "own.toml"))
    assert spec.robot == str(urdf)
    assert EnvSpec.from_json(spec.to_json()) == spec
    assert list(asset_hashes(spec.robot)) == ["corner.obj", "robot.toml", "tug.urdf"]
    env = make_environment(spec, backend="ideal", num_worlds=2)
    for _ in range(100):
        step = env.step(np.tile([1.0, 0.0], (2, 1)))
    speed = step.observation[:, env.observation_layout["velocimeter"]][:, 0]
    np.testing.assert_allclose(speed, 1.0, rtol=0.05)
    env.close()
