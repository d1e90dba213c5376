"""Ball joints: three hinges that turn and resist as the ball does, and names that say so."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from guard_api import rotations
from guard_api.model.dynamics import Dynamics
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import RobotModel
from tests.model.files import Z, complaint, joint, link, load, robot

DYNAMICS = '<dynamics damping="0.5" friction="0.25"/><limit effort="3" velocity="4"/>'
ORIGIN = {"xyz": "1 2 3", "rpy": "0.3 -0.2 0.1"}


def shoulder(folder: Path, toml: str | None = None, rest: str = DYNAMICS) -> RobotModel:
    """An upper arm that hangs on a ball joint, and a forearm."""
    return load(
        folder,
        link("torso"),
        link("arm"),
        link("forearm"),
        joint("elbow", "continuous", "arm", "forearm", Z),
        joint("ball", "ball", "torso", "arm", rest, **ORIGIN),
        toml=toml,
    )


def test_a_ball_becomes_three_hinges(tmp_path: Path) -> None:
    model = shoulder(tmp_path)
    assert model.link_names == ("torso", "ball_x", "ball_y", "arm", "forearm")
    assert model.joint_names == ("ball_x", "ball_y", "ball_z", "elbow")
    hinges = model.joints[:3]
    assert [(item.parent, item.child) for item in hinges] == [
        ("torso", "ball_x"),
        ("ball_x", "ball_y"),
        ("ball_y", "arm"),
    ]
    assert [item.axis for item in hinges] == [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    assert hinges[0].origin.position == (1.0, 2.0, 3.0)
    assert {item.kind for item in hinges} == {"continuous"}
    assert {(item.damping, item.friction_loss, item.effort_limit, item.velocity_limit) for item in hinges} == {
        (0.5, 0.25, 3.0, 4.0)
    }
    assert [item.virtual for item in model.links] == [False, True, True, False, False]


def test_a_ball_is_noted_once(tmp_path: Path) -> None:
    notes = shoulder(tmp_path, "base.kind = 'fixed'").notes
    assert [note for note in notes if "ball" in note and "velocity" not in note] == [
        "r.urdf:6: the joint type ball is an extension of GUARD: other readers of URDF refuse it",
        "ball joint 'ball' becomes the hinges 'ball_x', 'ball_y', 'ball_z', which are singular where 'ball_y' "
        "stands at +-90 degrees",
    ]
    notes = shoulder(tmp_path, rest='<axis xyz="0 0 0"/><limit lower="-1" upper="1"/>').notes
    assert "r.urdf:6: joint 'ball' is a ball: its axis is ignored" in notes
    assert "r.urdf:6: ball joint 'ball' turns freely: its position limits are ignored" in notes


def test_side_file_names_the_ball_or_a_hinge(tmp_path: Path) -> None:
    toml = """
    armature = { ball = 0.1, ball_y = 0.2, default = 0.3 }
    damping = { ball = 1.0 }
    stiffness = { ball_z = 2.0 }
    rest_position = { ball_z = 0.4 }
    home.joints = { ball_x = 0.5 }
    [[sensors]]
    kind = "relative_rotation"
    link = "arm"
    [[sensors]]
    kind = "joint_position"
    joint = "ball_x"
    """
    model = shoulder(tmp_path, toml)
    assert [item.armature for item in model.joints] == [0.1, 0.2, 0.1, 0.3]
    assert [item.damping for item in model.joints] == [1.0, 1.0, 1.0, 0.0]
    assert [item.stiffness for item in model.joints] == [0.0, 0.0, 2.0, 0.0]
    assert [item.rest_position for item in model.joints] == [0.0, 0.0, 0.4, 0.0]
    assert [(sensor.name, sensor.link, sensor.joint) for sensor in model.sensors] == [
        ("ballquat_arm", "arm", None),
        ("jointpos_ball_x", None, "ball_x"),
    ]


def test_the_child_turns_by_its_axes_in_turn(tmp_path: Path) -> None:
    kinematics = Kinematics(shoulder(tmp_path), ["arm"])
    a, b, c = 0.4, -1.1, 2.0
    poses = kinematics.poses(np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.array([[a, b, c, 0.0]]))
    expected = rotations.from_rpy(0.3, -0.2, 0.1)
    for axis, angle in zip(np.eye(3), (a, b, c), strict=True):
        expected = rotations.multiply(expected, rotations.from_axis_angle(axis, angle))
    sign = np.copysign(1.0, expected @ poses.quaternion[0, 0])
    np.testing.assert_allclose(poses.quaternion[0, 0], sign * expected, atol=1e-15)
    np.testing.assert_allclose(poses.position[0, 0], (1.0, 2.0, 3.0), atol=1e-15)


def test_it_resists_as_the_ball_does(tmp_path: Path) -> None:
    """A torque T (3,) in the child's axes turns a lone ball-jointed body from rest by I^-1 T, at any attitude."""
    inertial = '<inertial><mass value="2"/><inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0.1"/></inertial>'
    model = load(tmp_path, link("torso"), f'<link name="arm">{inertial}</link>', joint("ball", "ball", "torso", "arm"))
    dynamics = Dynamics(model, (0.0, 0.0, 0.0))
    q, upright, still = np.array([[0.7, -0.6, 0.9]]), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3))
    poses = dynamics.kinematics.poses(still, upright, q)
    turn = poses.quaternion[0, -1]
    axes = rotations.unrotate(turn, dynamics.kinematics.axes(poses)[:, :, 0].T)  # rows: in the child's axes
    torque = np.array([0.1, -0.2, 0.3])
    a = dynamics.acceleration(
        poses, still, still, still, effort=(axes @ torque)[None], thrust=np.zeros((1, 0, 3)), timestep=0.002
    )
    np.testing.assert_allclose(axes.T @ a[0], np.linalg.solve(model.links[-1].inertia, torque), rtol=1e-13)


def test_names_of_hinges_that_are_taken(tmp_path: Path) -> None:
    lines = complaint(
        tmp_path,
        robot(
            link("a"),
            link("b"),
            link("c"),
            joint("ball", "ball", "a", "b"),
            joint("ball_z", "continuous", "a", "c", Z),
        ),
    )
    assert lines == ["r.urdf:6: joint name 'ball_z' is taken already (r.urdf:5): rename one"]
    lines = complaint(tmp_path, robot(link("a"), link("ball_x"), joint("ball", "ball", "a", "ball_x")))
    assert lines[0] == "r.urdf:4: link name 'ball_x' is taken already (r.urdf:3): rename one"


def test_a_ball_is_no_joint_of_one_degree_of_freedom(tmp_path: Path) -> None:
    urdf = robot(link("a"), link("b"), joint("ball", "ball", "a", "b"))
    for toml, key in (
        ("[[actuators]]\nname = 'm'\nlaw = 'effort'\njoint = 'ball'", "actuators[0].joint"),
        ("[[sensors]]\nkind = 'joint_position'\njoint = 'ball'", "sensors[0].joint"),
        ("home.joints.ball = 0.1", "home.joints"),
        ("rest_position.ball = 0.1", "rest_position"),
    ):
        (line,) = complaint(tmp_path, urdf, toml)
        assert line.startswith(f"robot.toml: {key}: joint 'ball' does not exist: did you mean 'ball_")
