"""How a robot stands in the world: what the two files may say of it, and what the model then holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.model.files import A, B, Z, complaint, hinge, joint, link, load, robot


def test_a_planar_base_from_the_side_file(tmp_path: Path) -> None:
    toml = '[base]\nkind = "planar"\ndamping = [1, 2, 3]\narmature = [4, 5, 6]\n[home]\nheight = 0.7'
    robot = load(tmp_path, link("a"), toml=toml)
    assert robot.joint_names == ("base_x", "base_y", "base_yaw")
    assert [(item.damping, item.armature) for item in robot.joints] == [(1, 4), (2, 5), (3, 6)]
    assert [item.origin.position[2] for item in robot.joints] == [0.7, 0.0, 0.0]
    assert robot.root == "a"
    assert not robot.collide_ground


def test_a_planar_base_with_springs_that_walks_on_the_ground(tmp_path: Path) -> None:
    toml = """
    collide_ground = true
    stiffness.default = 7.0
    [base]
    kind = "planar"
    stiffness = [0.0, 0.5, 0.25]
    rest_position = [0.0, -1.0, 2.0]
    [home]
    height = 0.7
    """
    robot = load(tmp_path, link("a"), link("b"), joint("j", "continuous", "a", "b", Z), toml=toml)
    springs = [(item.stiffness, item.rest_position) for item in robot.joints]
    assert springs == [(0.0, 0.0), (0.5, -1.0), (0.25, 2.0), (7.0, 0.0)]  # defaults are not for the base
    assert robot.collide_ground
    assert (robot.home.height, robot.joints[0].origin.position) == (0.7, (0.0, 0.0, 0.7))


@pytest.mark.parametrize(
    ("kind", "axis", "noted"),
    [("continuous", "0 0 1", True), ("prismatic", "1 0 0", True),
     ("prismatic", "0 0 1", False), ("continuous", "1 0 0", False)],
)  # fmt: skip
def test_a_note_on_a_robot_held_at_a_height_that_nothing_in_it_can_give_way_to(kind, axis, noted, tmp_path) -> None:
    foot = link("b", '<collision><geometry><sphere radius="0.1"/></geometry></collision>')
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind == "prismatic" else ""
    parts = (link("a"), foot, joint("j", kind, "a", "b", f'<axis xyz="{axis}"/>{limit}'))
    notes = load(tmp_path, *parts, toml='collide_ground = true\n[base]\nkind = "planar"').notes
    assert any("at a fixed height" in note and "(b)" in note for note in notes) == noted
    assert not any("at a fixed height" in note for note in load(tmp_path, *parts, toml='[base]\nkind = "planar"').notes)


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_a_base_from_the_urdf(kind: str, tmp_path: Path) -> None:
    free = joint("free", kind, "world", "a", Z, xyz="0 0 0.3")
    robot = load(tmp_path, '<link name="world"/>', link("a"), link("b"), free, joint("j", "continuous", "a", "b", Z))
    assert robot.base == kind
    assert robot.home.height == 0.3
    assert robot.root == "a"
    assert robot.link_names[-2:] == ("a", "b")


def test_an_arm_on_a_world_link_is_fixed(tmp_path: Path) -> None:
    weld = joint("weld", "fixed", "world", "a", xyz="0 0 0.3")
    robot = load(tmp_path, '<link name="world"/>', link("a"), link("b"), weld, joint("j", "continuous", "a", "b", Z))
    assert robot.base == "fixed"
    assert robot.link_names == ("world", "b")
    assert robot.joints[0].origin.position == (0.0, 0.0, 0.3)


def test_an_empty_floating_root(tmp_path: Path) -> None:
    lines = complaint(tmp_path, robot('<link name="a"/>', B, hinge()), 'base.kind = "floating"')
    assert "r.urdf:2: link 'a' moves but has neither" in lines[0]


def test_reserved_names_of_a_planar_base(tmp_path: Path) -> None:
    lines = complaint(tmp_path, robot(A.replace('"a"', '"base_x"')), '[base]\nkind = "planar"')
    assert lines == ["r.urdf:2: the name 'base_x' belongs to the planar base: rename it"]


def test_a_base_that_is_stated_twice_and_differently(tmp_path: Path) -> None:
    world = '<link name="world"/>'
    ends = '<parent link="world"/><child link="a"/>'
    lines = complaint(tmp_path, robot(world, A, hinge("floating", ends=ends)), '[base]\nkind = "planar"')
    assert "robot.toml: base.kind: 'planar' contradicts the floating joint on 'world'" in lines[0]
    lines = complaint(tmp_path, robot(world, A, hinge("fixed", ends=ends)), 'base.kind = "floating"')
    assert "robot.toml: base.kind: 'floating' contradicts the root link 'world'" in lines[0]


def test_two_robots_on_one_world(tmp_path: Path) -> None:
    one, two = (hinge("floating", ends=f'<parent link="world"/><child link="{name}"/>') for name in "ab")
    lines = complaint(tmp_path, robot('<link name="world"/>', A, B, one, two.replace('"j"', '"k"')))
    assert lines == ["r.urdf:6: joints 'j' and 'k' both hang on 'world': keep one"]
