"""What a file means: merging, ordering, bases, computed inertials, meshes, and what is noted on the way."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import yourdfpy
from hypothesis import given
from hypothesis import strategies as st

from guard_api import rotations
from guard_api.model.inertia import of_shape
from guard_api.model.robot import PLANAR_JOINTS, Frame, RobotModel, Segment
from guard_api.model.writers import to_urdf
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from tests.model.files import Z, joint, link, load
from tests.model.random_robots import robots


def test_links_come_depth_first_in_file_order(tmp_path: Path) -> None:
    ends = [("d", "e"), ("a", "b"), ("b", "c"), ("a", "d")]
    joints = [joint(parent + child, "continuous", parent, child, Z) for parent, child in ends]
    robot = load(tmp_path, *joints, *(link(name) for name in "edcba"))
    assert robot.link_names == ("a", "b", "c", "d", "e")
    assert robot.joint_names == ("ab", "bc", "ad", "de")


ON_THE_TIP = """
reference = "tip"
lidar = ["root", "tip"]
friction = { default = 0.5, tip = 2.0, rubber = 3.0 }
[[actuators]]
name = "jet"
law = "thrust"
link = "tip"
point = [1, 0, 0]
direction = [0, 2, 0]
[[sensors]]
kind = "gyro"
link = "tip"
position = [0, 0, 1]
[[sensors]]
kind = "touch"
link = "tip"
position = [1, 0, 0]
[[segments]]
start = "arm"
end = "tip"
radius = 0.1
"""


def test_fixed_joints_are_merged_with_all_that_sits_on_them(tmp_path: Path) -> None:
    ball = '<collision{name}><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></collision>'
    robot = load(
        tmp_path,
        link("root"),
        link("arm", ball.format(name="")),
        link("tip", ball.format(name="") + ball.format(name=' name="rubber"'), mass=3.0),
        link("finger"),
        joint("shoulder", "continuous", "root", "arm", Z),
        joint("weld", "fixed", "arm", "tip", xyz="0 2 0", rpy=f"0 0 {math.pi / 2!r}"),
        joint("knuckle", "continuous", "tip", "finger", Z, xyz="0.5 0 0"),
        toml=ON_THE_TIP,
    )
    assert robot.link_names == ("root", "arm", "finger")
    arm = robot.links[1]
    assert arm.mass == 4.0
    np.testing.assert_allclose(arm.com, (0.0, 1.5, 0.0))
    np.testing.assert_allclose(arm.inertia, np.diag([0.4 + 3.0, 0.4, 0.4 + 3.0]), atol=1e-15)  # mu d^2 = 3/4 * 4
    places = [part.pose.position for part in arm.collisions]
    np.testing.assert_allclose(places, [(1, 0, 0), (0, 3, 0), (0, 3, 0)], atol=1e-15)
    assert [part.friction for part in arm.collisions] == [0.5, 2.0, 3.0]
    knuckle = robot.joints[1]
    assert knuckle.parent == "arm"
    np.testing.assert_allclose(knuckle.origin.position, (0.0, 2.5, 0.0), atol=1e-15)
    np.testing.assert_allclose(knuckle.origin.quaternion, (0.5**0.5, 0, 0, 0.5**0.5))
    (jet,), (gyro, touch) = robot.actuators, robot.sensors
    assert jet.link == gyro.link == touch.link == "arm"
    np.testing.assert_allclose((jet.point, jet.direction), [(0, 3, 0), (-1, 0, 0)], atol=1e-15)
    np.testing.assert_allclose(gyro.pose.position, (0, 2, 1))
    np.testing.assert_allclose(touch.pose.position, (0, 3, 0), atol=1e-15)
    assert touch.pose.quaternion == (1.0, 0.0, 0.0, 0.0)
    assert robot.touch_sensors == (touch,)
    assert "sensor 'touch_tip' feels touch on all of 'arm', which link 'tip' is merged into" in robot.notes
    tip = robot.reference
    assert tip is not None
    assert (tip.name, tip.link) == ("tip", "arm")
    np.testing.assert_allclose(tip.pose.position, (0.0, 2.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(tip.pose.quaternion, (0.5**0.5, 0, 0, 0.5**0.5))
    assert robot.lidar == (Frame(name="root", link="root"), tip)
    assert robot.segments == (Segment(start=Frame(name="arm", link="arm"), end=tip, radius=0.1),)
    assert "fixed joint 'weld': link 'tip' is merged into 'arm'" in robot.notes


def test_chains_of_fixed_joints_are_merged(tmp_path: Path) -> None:
    quarter = f"0 0 {math.pi / 2!r}"
    names = [f"l{i}" for i in range(5)]
    chain = [joint(f"j{i}", "fixed", a, b, xyz="1 0 0", rpy=quarter) for i, (a, b) in enumerate(pairwise(names))]
    robot = load(tmp_path, *map(link, names), *chain)
    assert robot.joints == ()
    assert robot.links[0].mass == 5.0
    np.testing.assert_allclose(robot.links[0].com, (2.0 / 5.0, 2.0 / 5.0, 0.0), atol=1e-15)  # around a unit square


def test_missing_inertials_come_from_geometry_at_the_stated_density(tmp_path: Path) -> None:
    shapes = (
        '<collision><geometry><box size="1 2 3"/></geometry></collision>'
        '<collision><origin xyz="0 0 2"/><geometry><capsule radius="0.1" length="0.4"/></geometry></collision>'
    )
    robot = load(tmp_path, f'<link name="a">{shapes}</link>', toml='density = 10\nbase.kind = "floating"')
    box = of_shape(Box(half_extents=(0.5, 1.0, 1.5)), 10.0)
    capsule = of_shape(Capsule(radius=0.1, half_length=0.2), 10.0)
    assert robot.links[0].mass == pytest.approx(box.mass + capsule.mass, rel=1e-15)
    assert robot.links[0].com[2] == pytest.approx(2.0 * capsule.mass / robot.links[0].mass)
    assert any("link 'a' has no <inertial>" in note and "10 kg/m^3" in note for note in robot.notes)


def test_shapes_are_read_with_half_lengths(tmp_path: Path) -> None:
    geometries = [
        '<sphere radius="0.1"/>',
        '<box size="1 2 3"/>',
        '<cylinder radius="0.1" length="2"/>',
        '<capsule radius="0.1" length="2"/>',
    ]
    robot = load(tmp_path, link("a", "".join(f"<collision><geometry>{g}</geometry></collision>" for g in geometries)))
    assert [part.shape for part in robot.links[0].collisions] == [
        Sphere(radius=0.1),
        Box(half_extents=(0.5, 1.0, 1.5)),
        Cylinder(radius=0.1, half_length=1.0),
        Capsule(radius=0.1, half_length=1.0),
    ]


@pytest.mark.parametrize("filename", ["mesh/cube.obj", "package://pack/mesh/cube.obj", "file://{folder}/mesh/cube.obj"])
def test_meshes_become_scaled_hulls(filename: str, tmp_path: Path) -> None:
    folder = tmp_path / "pack"
    (folder / "mesh").mkdir(parents=True)
    corners = [(x, y, z) for x in (0, 2) for y in (0, 2) for z in (0, 2)] + [(1, 1, 1)]  # the last is inside
    faces = [(1, 2, 3), (2, 4, 3), (5, 7, 6), (6, 7, 8), (1, 3, 5), (3, 7, 5), (2, 6, 4), (4, 6, 8), (1, 9, 2)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    (folder / "mesh/cube.obj").write_text("\n".join(lines))
    name = filename.format(folder=folder)
    shape = f'<collision><geometry><mesh filename="{name}" scale="0.5 0.5 1"/></geometry></collision>'
    robot = load(folder, f'<link name="a">{shape}</link>', toml='density = 3\nbase.kind = "floating"')
    hull = robot.links[0].collisions[0].shape
    assert isinstance(hull, Mesh)
    assert sorted(hull.vertices) == sorted((0.5 * x, 0.5 * y, 1.0 * z) for x, y, z in corners[:8])
    assert robot.links[0].mass == pytest.approx(6.0)
    np.testing.assert_allclose(robot.links[0].com, (0.5, 0.5, 1.0))


def test_a_mesh_that_changed_is_read_again(tmp_path: Path) -> None:
    text = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
    shape = '<collision><geometry><mesh filename="m.obj"/></geometry></collision>'
    sizes = []
    for size in (1, 2):
        (tmp_path / "m.obj").write_text(text.format(size))
        hull = load(tmp_path, link("a", shape)).links[0].collisions[0].shape
        assert isinstance(hull, Mesh)
        sizes.append(np.max(hull.vertices))
    assert sizes == [1.0, 2.0]


def test_a_missing_visual_mesh_is_only_noted(tmp_path: Path) -> None:
    robot = load(tmp_path, link("a", '<visual><geometry><mesh filename="no.dae"/></geometry></visual>'))
    assert robot.links[0].visuals == ()
    assert any("'no.dae' does not exist" in note for note in robot.notes)


def test_colours_come_from_named_materials(tmp_path: Path) -> None:
    visual = '<visual><geometry><sphere radius="1"/></geometry>{}</visual>'
    robot = load(
        tmp_path,
        '<material name="red"><color rgba="1 0 0 1"/></material>',
        link("a", "".join(visual.format(m) for m in ('<material name="red"/>', "", '<material name="none"/>'))),
    )
    default = (1.0, 0.6, 0.0, 1.0)
    assert [part.rgba for part in robot.links[0].visuals] == [(1.0, 0.0, 0.0, 1.0), default, default]
    assert any("material 'none' has no colour" in note for note in robot.notes)


def test_an_empty_link_between_two_joints_is_massless(tmp_path: Path) -> None:
    joints = joint("x", "continuous", "a", "cross", Z), joint("y", "continuous", "cross", "b", Z)
    robot = load(tmp_path, link("a"), '<link name="cross"/>', link("b"), *joints)
    assert [item.virtual for item in robot.links] == [False, True, False]
    assert "link 'cross' is empty: it is a massless link between two joints" in robot.notes


def test_axes_are_normalised_and_defaults_are_those_of_urdf(tmp_path: Path) -> None:
    joints = joint("x", "continuous", "a", "b"), joint("y", "continuous", "b", "c", '<axis xyz="0 3 4"/>')
    robot = load(tmp_path, link("a"), link("b"), link("c"), *joints)
    assert [item.axis for item in robot.joints] == [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8)]
    assert robot.joints[0].effort_limit == math.inf


def moved(inertia: str) -> str:
    """A link of 1 kg with this inertia about every axis, on a hinge."""
    return link("a") + link("b").replace('"0.1"', f'"{inertia}"') + joint("j", "continuous", "a", "b", Z)


NOTED = {
    "foreign tag": (
        link("a") + "\n<gazebo/><gazebo/>",
        "r.urdf: <gazebo> in <robot> is ignored (2 times, first at line 3)",
    ),
    "transmission": (link("a") + "<transmission/>", "<transmission> in <robot> is ignored"),
    "foreign attribute": (link("a").replace("<mass", '<mass unit="kg"'), "attribute unit of <mass> is ignored"),
    "large": (link("a", '<collision><geometry><sphere radius="500"/></geometry></collision>'), "more than 100 m"),
    "heavy": (link("a", mass=2e5), "masses are in kilograms"),
    "inertia in g mm^2": (moved(inertia="1e8"), "radius of gyration of 1e+04 m: inertias are in kg m^2"),
    "inertia next to none": (moved(inertia="1e-9"), "radius of gyration of 3.2e-05 m: inertias are in"),
    "no base": (link("a"), "no kind of base is stated"),
    "no side file": (link("a"), "no robot.toml"),
    "degrees": (
        link("a") + link("b") + joint("j", "revolute", "a", "b", f'{Z}<limit lower="-90" upper="90"/>'),
        "angles are in radians, not degrees",
    ),
    "rpy in degrees": (
        link("a") + link("b") + joint("j", "continuous", "a", "b", Z, rpy="0 90 0"),
        "rpy 0 90 0 looks like degrees",
    ),
    "one limit": (
        link("a") + link("b") + joint("j", "revolute", "a", "b", f'{Z}<limit upper="1"/>'),
        "joint 'j' has no lower limit: it is 0",
    ),
    "home outside its limits": (
        link("a") + link("b") + joint("j", "revolute", "a", "b", f'{Z}<limit lower="1" upper="2"/>'),
        "joint 'j' starts at 0, outside its limits 1, 2",
    ),
    "no effort": (
        link("a") + link("b") + joint("j", "continuous", "a", "b", f'{Z}<limit effort="0" velocity="0"/>'),
        "its effort limit is 0",
    ),
}


@pytest.mark.parametrize("case", NOTED)
def test_what_the_reader_is_not_sure_of_is_noted(case: str, tmp_path: Path) -> None:
    content, expected = NOTED[case]
    notes = load(tmp_path, content).notes
    assert any(expected in note for note in notes), notes


def own_poses(model: RobotModel, q: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Position and rotation matrix of every link from the root on, in root axes."""
    poses = {model.root: (np.zeros(3), np.eye(3))}
    for item in model.joints:
        if item.parent in poses:
            p, R = poses[item.parent]
            p, R = p + R @ item.origin.position, R @ rotations.to_matrix(item.origin.quaternion)
            if item.kind == "prismatic":
                p = p + R @ item.axis * q[item.name]
            else:
                R = R @ rotations.to_matrix(rotations.from_axis_angle(item.axis, q[item.name]))
            poses[item.child] = (p, R)
    return poses


@given(robots(), st.integers(0, 2**32 - 1))
def test_another_reader_puts_the_links_in_the_same_places(model: RobotModel, seed: int) -> None:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "r.urdf"
        file.write_text(to_urdf(model).replace("<capsule", "<cylinder"))  # the other reader knows no capsules
        other = yourdfpy.URDF.load(str(file), build_scene_graph=True, load_meshes=False)
    moving = [item.name for item in model.joints if item.name not in PLANAR_JOINTS]
    q = dict(zip(moving, np.random.default_rng(seed).uniform(-1.0, 1.0, len(moving)), strict=True))
    other.update_cfg(q)
    for name, (position, R) in own_poses(model, q).items():
        T = other.get_transform(name, model.root)
        np.testing.assert_allclose(T[:3, 3], position, rtol=0, atol=1e-12)
        np.testing.assert_allclose(T[:3, :3], R, rtol=0, atol=1e-12)


FALL = "no link has a collision shape: the robot falls through the floor"
IDLE = "no [[actuators]]: nothing can move the robot"
MOTOR = '[[actuators]]\nname = "m"\nlaw = "effort"\njoint = "j"\n'


def test_what_a_robot_lacks_to_be_of_use_is_noted(tmp_path: Path) -> None:
    def noted(beginning: str, ball: str, base: str, motor: str = "", rest: str = "") -> bool:
        hinge = joint("j", "continuous", "a", "b", Z + rest)
        notes = load(tmp_path, link("a", ball), link("b"), hinge, toml=f"base.kind = '{base}'\n{motor}").notes
        return any(note.startswith(beginning) for note in notes)

    ball = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    assert noted(FALL, "", "floating")
    assert not noted(FALL, ball, "floating")
    assert not noted(FALL, "", "fixed")
    assert noted(IDLE, ball, "fixed")
    assert not noted(IDLE, ball, "fixed", MOTOR)
    slow = "velocity limits are not enforced (j)"
    assert noted(slow, ball, "fixed", MOTOR, rest='<limit effort="1" velocity="2"/>')
    assert not noted(slow, ball, "fixed", MOTOR, rest='<limit effort="1"/>')
