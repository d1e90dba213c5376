"""A robot that is written and read back is the same robot."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guard_api import rotations
from guard_api.errors import ModelError
from guard_api.model.inertia import of_solids
from guard_api.model.library import load_robot, load_robot_file, robot_names
from guard_api.model.robot import Collision, Frame, Joint, Link, RobotModel
from guard_api.model.writers import mesh_files, rpy, to_side_file, to_urdf
from guard_api.shapes import Mesh, Pose
from tests.model.files import joint, link, load
from tests.model.random_robots import quaternions, robots


def round_trip(model: RobotModel, folder: Path) -> RobotModel:
    (folder / "r.urdf").write_text(to_urdf(model))
    (folder / "robot.toml").write_text(to_side_file(model))
    for name, text in mesh_files(model).items():
        (folder / name).write_text(text)
    return load_robot_file(folder / "r.urdf")


def assert_same(a: object, b: object, path: str = "robot") -> None:
    """Equal field by field; numbers to 1e-15 of their size, or absolute below 1, quaternions up to sign."""
    if is_dataclass(a):
        assert type(a) is type(b), path
        for field in fields(a):
            if field.name not in {"notes", "source", "quaternion"}:
                assert_same(getattr(a, field.name), getattr(b, field.name), f"{path}.{field.name}")
            elif field.name == "quaternion":
                p, q = (np.array(pose.quaternion) for pose in (a, b))
                assert np.abs(p - np.copysign(1.0, p @ q) * q).max() <= 1e-15, (path, p, q)
    elif isinstance(a, tuple):
        assert len(a) == len(b), path
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{path}[{i}]")
    elif isinstance(a, float):
        assert a == b or abs(a - b) <= 1e-15 * max(1.0, abs(a)), (path, a, b)
    else:
        assert a == b, (path, a, b)


@given(robots())
def test_a_robot_survives_writing_and_reading(model: RobotModel) -> None:
    with TemporaryDirectory() as folder:
        assert_same(model, round_trip(model, Path(folder)))


@given(robots())
def test_inertials_limits_and_gains_keep_every_bit(model: RobotModel) -> None:
    with TemporaryDirectory() as folder:
        again = round_trip(model, Path(folder))
    for before, after in zip(model.links, again.links, strict=True):
        assert (before.mass, before.com, before.inertia) == (after.mass, after.com, after.inertia)
    for before, after in zip(model.joints, again.joints, strict=True):
        assert before == replace(after, origin=before.origin, axis=before.axis)


@given(robots())
def test_no_line_is_long(model: RobotModel) -> None:
    assert max(map(len, to_urdf(model).splitlines())) < 8000


@settings(max_examples=300)
@given(quaternions())
def test_rpy_is_exact_at_every_attitude(quaternion: tuple[float, float, float, float]) -> None:
    q = rotations.from_rpy(*rpy(quaternion))
    assert min(np.abs(q - quaternion).max(), np.abs(q + quaternion).max()) <= 1e-15


@pytest.mark.parametrize("name", robot_names())
def test_shipped_robots_survive(name: str, tmp_path: Path) -> None:
    assert_same(load_robot(name), round_trip(load_robot(name), tmp_path))


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_hulls_survive(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(12, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)  # on a sphere, so that each is a corner
    hull = Mesh(vertices=tuple(map(tuple, points.tolist())), source="here")
    properties = of_solids([(hull, Pose())], 100.0)
    part = Collision(shape=hull, friction=0.3)
    link = Link(name="a", mass=properties.mass, com=properties.com, inertia=properties.inertia, collisions=(part,))
    model = RobotModel(name="m", base="floating", root="a", links=(link,), joints=(), actuators=())
    with TemporaryDirectory() as folder:
        again = round_trip(model, Path(folder))
    shape = again.links[0].collisions[0].shape
    assert isinstance(shape, Mesh)
    assert sorted(shape.vertices) == sorted(hull.vertices)


def test_a_ball_survives(tmp_path: Path) -> None:
    parts = link("a"), link("b"), joint("ball", "ball", "a", "b", xyz="1 0 0", rpy="1 2 3")
    model = load(tmp_path, *parts, toml="armature.ball = 0.1\ndamping.ball_y = 0.2\nstiffness.ball = 0.3")
    assert_same(model, round_trip(model, tmp_path))


def test_frames_become_empty_links_with_free_joint_names() -> None:
    links = Link(name="a", mass=1.0), Link(name="b", mass=1.0)
    hinge = Joint(name="tip", kind="continuous", parent="a", child="b")
    tip = Frame(name="tip", link="b", pose=Pose(position=(1.0, 0.0, 0.0)))
    model = RobotModel(
        name="m", base="fixed", root="a", links=links, joints=(hinge,), actuators=(), reference=tip, lidar=(tip,)
    )
    assert to_urdf(model).count('<link name="tip"/>') == 1
    assert '<joint name="tip_frame" type="fixed">' in to_urdf(model)
    for other in (replace(tip, name="a"), replace(tip, link="a")):
        with pytest.raises(ModelError, match=f"frame '{other.name}' .* the name belongs to another place"):
            to_urdf(replace(model, lidar=(other,)))


def test_an_unlimited_slide_is_refused() -> None:
    links = (Link(name="a", mass=0.0), Link(name="b", mass=1.0))
    joint = Joint(name="slide", kind="prismatic", parent="a", child="b")
    model = RobotModel(name="m", base="fixed", root="a", links=links, joints=(joint,), actuators=())
    with pytest.raises(ModelError, match="slide"):
        to_urdf(model)
