"""MJCF as MuJoCo compiles it: masses, frames, joints, dynamics and actuation of the same text, to 1e-9."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from guard_api.model.ball import ball_hinges
from tests.model.mjcf_comparison import Pair, read
from tests.model.random_mjcf import texts


def robot(*lines: str, before: str = "", after: str = "", fixed: bool = False) -> str:
    """A robot with a torso, free unless `fixed`, that carries `lines`; accelerometers sit at the sites s0, s1, ..."""
    sites = "".join(f'<accelerometer name="a{i}" site="s{i}"/>' for i in range(8) if f'"s{i}"' in "".join(lines))
    free = "" if fixed else "<freejoint/>"
    body = "\n".join(lines)
    return (
        f'<mujoco>{before}<worldbody><body name="torso" pos="0 0 0.5">{free}<geom size="0.1"/>\n{body}</body>'
        f"</worldbody>{after}<sensor>{sites}</sensor></mujoco>"
    )


def leg(joints: str, rest: str = "", pos: str = "0.1 -0.2 0.3", attributes: str = "") -> str:
    return (
        f'<body name="leg" pos="{pos}" {attributes}>{joints}<geom type="capsule" size="0.03 0.1" pos="0 0.05 0"/>'
        f'<site name="s0"/><site name="s1" pos="0.1 0 0" euler="10 20 30"/>{rest}</body>'
    )


TEXTS = {
    "one hinge": robot(leg('<joint name="a"/>')),
    "a fixed base": robot(leg('<joint name="a" axis="1 2 3"/>'), fixed=True),
    "a slide": robot(leg('<joint name="a" type="slide" axis="0 -1 1" range="-0.1 0.2"/>')),
    "a hinge away from the body's origin": robot(leg('<joint name="a" axis="0 1 0" pos="0.1 0.2 0.3"/>')),
    "a hinge whose axis meets the body's origin": robot(leg('<joint name="a" axis="0 0 1" pos="0 0 0.3"/>')),
    "a slide away from the body's origin": robot(leg('<joint name="a" type="slide" pos="0.1 0.2 0.3"/>')),
    "several joints": robot(
        leg('<joint name="a" axis="1 0 0"/><joint name="b" axis="0 1 0"/><joint name="c" type="slide" axis="1 1 0"/>')
    ),
    "several joints at several places": robot(
        leg(
            '<joint name="a" axis="1 0 0" pos="0 0.1 0"/><joint name="b" type="slide"/>'
            '<joint name="c" axis="0 1 0" pos="0.2 0 0.1"/>',
            '<body name="foot" pos="0 0 -0.3"><joint name="d" axis="0 1 0" pos="0 0 0.1"/><geom size="0.02"/></body>',
        )
    ),
    "a body called like its joint": robot(
        leg(
            '<joint name="leg" axis="1 0 0" pos="0 0.1 0"/><joint name="foot" axis="0 1 0"/>',
            '<body name="foot"><geom size="0.02"/></body>',
        )
    ),
    "references": robot(
        leg(
            '<joint name="a" axis="1 0 1" pos="0 0.1 0" ref="40" range="-10 90" springref="25" stiffness="3"/>'
            '<joint name="b" type="slide" ref="0.2" range="-1 1" springref="0.1" stiffness="4"/>'
        )
    ),
    "radians": robot(
        leg('<joint name="a" range="-1 1" ref="0.3" springref="0.2"/>', attributes='euler="0.1 0.2 0.3"'),
        before='<compiler angle="radian"/>',
    ),
    "no automatic limits": robot(
        leg('<joint name="a" range="-10 10" limited="true"/><joint name="b" range="-1 1" limited="false"/>'),
        before='<compiler autolimits="false"/>',
    ),
    "nested defaults": robot(
        leg(
            '<joint name="a"/><joint name="b" class="hip"/><joint name="c" class="knee" damping="9"/>',
            '<body name="foot" pos="0 0 -0.3" childclass="knee"><joint name="d"/><geom/></body>',
            attributes='childclass="hip"',
        ),
        before=(
            '<default><joint damping="1" armature="0.5"/><geom density="300"/><default class="hip">'
            '<joint axis="1 0 0" damping="2" range="-20 30"/><default class="knee"><joint axis="0 1 0" stiffness="3"/>'
            '<geom type="box" size="0.1 0.2 0.3"/></default></default></default>'
        ),
    ),
    "welded bodies": robot(
        leg(
            '<joint name="a" pos="0 0 0.1" axis="1 0 0"/>',
            '<body name="shin" pos="0.1 0 0" quat="1 1 0 0"><geom size="0.03"/><site name="s2" pos="0 0 1"/>'
            '<body name="foot" pos="0 0.2 0"><geom type="box" size="0.1 0.02 0.03"/></body></body>',
        )
    ),
    "inertials": robot(
        leg('<joint name="a"/><inertial pos="0 0.1 0" mass="2" diaginertia="0.01 0.02 0.025" euler="10 20 30"/>'),
        '<body name="full"><joint name="b"/><inertial pos="0 0 0" mass="1" '
        'fullinertia="0.02 0.03 0.04 0.001 -0.002 0.003"/></body>',
    ),
    "geoms over inertials": robot(
        leg('<joint name="a"/><inertial pos="0 0.1 0" mass="2" diaginertia="0.01 0.02 0.025"/>'),
        before='<compiler inertiafromgeom="true"/>',
    ),
    "groups without mass": robot(
        leg('<joint name="a"/><geom size="0.2" group="4"/>'), before='<compiler inertiagrouprange="0 3"/>'
    ),
    "all shapes": robot(
        leg(
            '<joint name="a"/><geom type="sphere" size="0.1 9 9"/><geom type="box" size="0.1 0.2 0.3" mass="0.5"/>'
            '<geom type="cylinder" size="0.1 0.2" euler="30 0 0"/><geom type="capsule" size="0.1 0.2" density="20"/>'
            '<geom type="ellipsoid" size="0.1 0.2 0.3" contype="0" conaffinity="0"/><geom size="0.4" mass="0"/>'
        )
    ),
    "from point to point": robot(
        leg(
            '<joint name="a"/><geom type="capsule" fromto="0 0 0 0.1 0.2 -0.3" size="0.02"/>'
            '<geom type="cylinder" fromto="0 0 0.3 0 0 0" size="0.02"/>'
            '<geom type="box" fromto="1 2 3 2 2 1" size="0.1"/>'
            '<geom type="ellipsoid" fromto="0 0 -0.3 0 0 0" size="0.1" contype="0" conaffinity="0"/>'
        )
    ),
    "every orientation": robot(
        leg('<joint name="a"/>', attributes='quat="1 2 3 4"'),
        '<body name="b1" axisangle="1 2 3 40"><joint name="b"/><geom size="0.1"/><site name="s2" pos="1 2 3"/></body>',
        '<body name="b2" xyaxes="1 2 3 0 1 -1"><joint name="c"/><geom size="0.1"/><site name="s3" pos="1 2 3"/></body>',
        '<body name="b3" zaxis="1 2 -3"><joint name="d"/><geom size="0.1"/><site name="s4" pos="1 2 3"/></body>',
        '<body name="b4" zaxis="0 0 -1"><joint name="e"/><geom size="0.1"/><site name="s5" pos="1 2 3"/></body>',
    ),
    "frames": robot(
        '<frame pos="0.1 0.2 0.3" euler="0 90 0"><frame euler="10 0 0" childclass="c">',
        leg('<joint name="a"/>'),
        '</frame><geom size="0.1" pos="1 0 0"/></frame>',
        '<body name="b1"><frame pos="0 1 0" euler="40 50 60"><joint name="b" pos="0 0.1 0.2"/>'
        '<inertial pos="0 0 1" mass="2" diaginertia="1 1.2 1.4"/><site name="s2" pos="1 2 3"/></frame></body>',
        before='<default><default class="c"><joint axis="1 0 0" damping="3"/></default></default>',
    ),
    "a tilted fixed base": robot(leg('<joint name="a"/>'), fixed=True).replace(
        'pos="0 0 0.5"', 'pos="1 2 0.5" euler="10 20 30"'
    ),
    "a base on joints": robot('<joint name="x" type="slide" axis="1 0 0"/>', leg('<joint name="a"/>'), fixed=True),
}


@pytest.mark.parametrize("case", TEXTS)
def test_one_robot_with_mujoco(tmp_path: Path, case: str) -> None:
    Pair(read(tmp_path, TEXTS[case]), TEXTS[case]).assert_same()


@pytest.mark.parametrize("sequence", ["xyz", "zyx", "xyx", "XYZ", "ZXY", "xYz", "XyZ"])
def test_euler_sequences(tmp_path: Path, sequence: str) -> None:
    text = robot(leg('<joint name="a"/>', attributes='euler="10 -70 130"'), before=f'<compiler eulerseq="{sequence}"/>')
    Pair(read(tmp_path, text), text).assert_same()


def test_a_planar_base_is_its_three_joints(tmp_path: Path) -> None:
    text = robot(
        '<joint name="x" type="slide" axis="1 0 0" damping="2" armature="0.3" limited="false" range="0 1"/>'
        '<joint name="y" type="slide" axis="0 1 0" stiffness="1" springref="0.1"/>'
        '<joint name="yaw" damping="0.5" pos="0 0 2"/>',
        leg('<joint name="a"/>'),
        after='<actuator><motor name="m" joint="yaw" gear="-2" ctrlrange="-1 1"/></actuator>',
        fixed=True,
    )
    model = read(tmp_path, text, '[base]\nkind = "planar"')
    assert (model.base, model.home.height, model.root) == ("planar", 0.5, "torso")
    pair = Pair(model, text, base=("x", "y", "yaw"))
    pair.assert_same()
    pair.assert_same_actuation()


def test_a_ball_joint_turns_alike(tmp_path: Path) -> None:
    text = robot(leg('<joint name="b" type="ball" pos="0 0.1 0.2" damping="0.5"/>'))
    model = read(tmp_path, text)
    hinges = ball_hinges("b")
    assert [joint.name for joint in model.joints] == list(hinges)
    assert [joint.damping for joint in model.joints] == [0.5] * 3
    theirs, angles = mujoco.MjModel.from_xml_string(text), np.array([0.3, -0.4, 0.5])
    data = mujoco.MjData(theirs)
    quaternion, part = np.array([1.0, 0, 0, 0]), np.zeros(4)
    for axis, angle in zip(np.eye(3), angles, strict=True):
        mujoco.mju_axisAngle2Quat(part, axis, angle)
        mujoco.mju_mulQuat(quaternion, quaternion.copy(), part)
    data.qpos[7:] = quaternion
    mujoco.mj_forward(theirs, data)
    pair = Pair.__new__(Pair)
    pair.robot, pair.data, pair.model = model, data, theirs
    from guard_api.model.kinematics import Kinematics

    poses = Kinematics(model).poses(data.qpos[None, :3], data.qpos[None, 3:7], angles[None])
    where = {name: (poses.position[0, i], poses.quaternion[0, i]) for i, name in enumerate(model.link_names)}
    pair._assert_same_sites(where)
    pair._assert_same_bodies(where)


ACTUATORS = {
    "motor": '<motor name="m" joint="a" gear="3" ctrlrange="-1 2" forcerange="-1.5 1.5"/>',
    "position": '<position name="m" joint="a" kp="5" kv="0.3" gear="2" ctrlrange="-1 1" forcerange="-4 4"/>',
    "position of defaults": '<position name="m" joint="a" ctrlrange="-1 1"/>',
    "position within the joint's range": '<position name="m" joint="a" inheritrange="0.5"/>',
    "velocity": '<velocity name="m" joint="a" kv="0.5" gear="-0.3" ctrlrange="-1 1"/>',
    "general motor": '<general name="m" joint="a" gainprm="7" gear="2" ctrlrange="-1 1"/>',
    "general position": (
        '<general name="m" joint="a" gainprm="7" biastype="affine" biasprm="1 -3 -0.2" gear="2" ctrlrange="-1 1"/>'
    ),
    "general velocity": (
        '<general name="m" joint="a" gainprm="7" biastype="affine" biasprm="0.5 0 -2" gear="2" ctrlrange="-1 1"/>'
    ),
    "thrust": '<motor name="m" site="s1" gear="1 2 -3 0 0 0" ctrlrange="-1 1" forcerange="-0.5 0.5"/>',
    "two on one joint": (
        '<motor name="m" joint="a" gear="3" ctrlrange="-1 2"/><motor name="n" joint="a" ctrlrange="-2 1"/>'
    ),
    "defaults for all kinds": '<general name="g" class="strong" joint="a"/><velocity class="strong" joint="b"/>',
}


@pytest.mark.parametrize("case", ACTUATORS)
def test_actuators_push_alike(tmp_path: Path, case: str) -> None:
    text = robot(
        leg('<joint name="a" axis="1 2 3" range="-50 90" actuatorfrcrange="-6 6"/><joint name="b" type="slide"/>'),
        before=(
            '<default><default class="strong"><motor gear="30" ctrlrange="-0.5 0.5"/><general forcerange="-2 2"/>'
            "</default></default>"
        ),
        after=f"<actuator>{ACTUATORS[case]}</actuator>",
    )
    Pair(read(tmp_path, text), text).assert_same_actuation()


def test_meshes(tmp_path: Path) -> None:
    import trimesh

    (tmp_path / "meshes").mkdir()
    solid = trimesh.creation.box((0.25, 0.5, 1.0))
    solid.apply_translation((0.125, 0.25, 0.5))
    solid.export(tmp_path / "meshes" / "corner.stl")
    ring = trimesh.creation.annulus(0.5, 1.0, 0.5)
    ring.vertices = np.round(ring.vertices * 1024.0) / 1024.0  # MuJoCo reads vertices as float32
    ring.export(tmp_path / "meshes" / "ring.obj")
    text = robot(
        leg(
            '<joint name="a"/><geom type="mesh" mesh="corner" euler="10 20 30" pos="0.1 0 0"/>'
            '<geom mesh="ring" type="mesh" mass="0.2"/><geom mesh="hull" type="mesh" density="20"/>'
        ),
        before=(
            f'<compiler meshdir="{tmp_path}/meshes"/><asset><mesh file="corner.stl" scale="1 2 3"/>'
            '<mesh name="ring" file="ring.obj" inertia="exact"/>'
            '<mesh name="hull" file="ring.obj" inertia="convex"/></asset>'
        ),
    )
    model = read(tmp_path, text)
    assert len(model.links[1].collisions) == 4
    Pair(model, text).assert_same()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(text=texts())
def test_any_robot(tmp_path: Path, text: str) -> None:
    pair = Pair(read(tmp_path, text), text)
    pair.assert_same()
    if pair.robot.actuators:
        pair.assert_same_actuation()


def test_limits_in_degrees_are_exact(tmp_path: Path) -> None:
    text = robot(leg('<joint name="a" range="-180 30"/>'))
    assert read(tmp_path, text).joints[0].limits == pytest.approx((-math.pi, math.pi / 6.0), rel=1e-15)
