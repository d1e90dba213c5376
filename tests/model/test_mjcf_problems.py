"""Faults of MJCF files: each is reported at its line, and all of a file at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from guard_api.errors import ModelError
from tests.model.mjcf_comparison import read
from tests.model.test_mjcf import PLANAR, TEXT


def file(*lines: str, inside: str = '<geom size="0.1"/>', after: str = "") -> str:
    """A free body a in line 3 with `lines` from line 4 on, then `inside`; `after` on the line of </worldbody>."""
    return "\n".join(
        [
            "<mujoco>",
            "<worldbody>",
            '<body name="a"><freejoint/>',
            *lines,
            inside,
            f"</body></worldbody>{after}</mujoco>",
        ]
    )


def hinge(attributes: str, rest: str = '<geom size="0.1"/>') -> str:
    """A body b on a joint j in line 4."""
    return file(f'<body name="b"><joint name="j" {attributes}/>{rest}</body>')


def driven(actuator: str, *, sensor: str = "") -> str:
    """An actuator in line 6, on the hinge j."""
    return file(
        '<body name="b"><joint name="j"/><geom size="0.1"/><site name="s"/></body>',
        after=f"<actuator>{actuator}</actuator><sensor>{sensor}</sensor>",
    )


def set_up(element: str, attributes: str = "") -> str:
    """An element before the bodies, in line 2."""
    return file(inside=f'<geom size="0.1" {attributes}/>').replace("<worldbody>", f"{element}<worldbody>")


FAULTS = {
    "malformed": ("<mujoco>\n<worldbody>\n</mujoco>", "r.xml:3: malformed XML"),
    "a URDF": ("<robot name='r'/>", "r.xml:1: the outermost element is <robot>"),
    "no body": ("<mujoco><worldbody/></mujoco>", "r.xml:1: <mujoco> has no <worldbody> with a <body>"),
    "two roots": (
        file(after="").replace("</worldbody>", "<body/></worldbody>"),
        "r.xml:5: a second body in <worldbody>: a robot has one root",
    ),
    "misspelt attribute": (
        hinge('dampng="1"'),
        "r.xml:4: unknown attribute 'dampng' in <joint>: did you mean 'damping'",
    ),
    "misspelt element": (file("<goem size='1'/>"), "r.xml:4: unknown 'goem' in <MJCF>: did you mean 'geom'"),
    "include": (file('<include file="x.xml"/>'), "r.xml:4: <include> is not supported: put the included elements"),
    "loop": (
        file(after='<equality><connect body1="b" body2="c"/></equality>'),
        "r.xml:5: <connect> in <equality> is not supported",
    ),
    "replicate": (file("<replicate/>"), "r.xml:4: <replicate> is not supported"),
    "global coordinates": (set_up('<compiler coordinate="global"/>'), "r.xml:2: global coordinates are not supported"),
    "scaled masses": (set_up('<compiler settotalmass="3"/>'), "r.xml:2: <compiler> settotalmass changes masses"),
    "least mass": (set_up('<compiler boundmass="0.1"/>'), "r.xml:2: <compiler> boundmass changes masses"),
    "unknown angle": (set_up('<compiler angle="grad"/>'), "r.xml:2: <compiler> angle='grad': did you mean 'radian'"),
    "unknown sequence": (set_up('<compiler eulerseq="abc"/>'), "r.xml:2: <compiler> eulerseq='abc' must be three of"),
    "no timestep": (set_up('<option timestep="0"/>'), "r.xml:2: <option> timestep 0 must be positive"),
    "unknown class": (hinge('class="big"'), "r.xml:4: default class 'big' does not exist: known: main"),
    "unknown childclass": (
        file('<body name="b" childclass="x"><geom size="1"/></body>'),
        "r.xml:4: default class 'x' does not",
    ),
    "a class twice": (
        set_up("<default><default class='a'/><default class='a'/></default>"),
        "r.xml:2: default class 'a' is defined already",
    ),
    "a default twice": (
        set_up("<default><geom density='1'/><geom density='2'/></default>"),
        "r.xml:2: class 'main' has more than one <geom>",
    ),
    "another main class": (set_up('<default class="a"/>'), "r.xml:2: the outermost default class is called 'main'"),
    "joint type": (hinge('type="hing"'), "r.xml:4: <joint> type='hing': did you mean 'hinge'"),
    "zero axis": (hinge('axis="0 0 0"'), "r.xml:4: joint 'j': the axis is zero"),
    "a range nothing switches on": (
        hinge('range="-1 1"').replace("<worldbody>", '<compiler autolimits="false"/><worldbody>'),
        "r.xml:4: <joint> has range but not limited",
    ),
    "limited without a range": (hinge('limited="true"'), 'r.xml:4: <joint> has limited="true" but no range'),
    "decreasing range": (hinge('range="1 -1"'), "r.xml:4: <joint> range 1 -1 must be increasing"),
    "negative damping": (hinge('damping="-1"'), "r.xml:4: <joint> damping -1 must not be negative"),
    "not a number": (hinge('armature="much"'), "r.xml:4: <joint> armature: 'much' is not a finite number"),
    "too many numbers": (hinge('pos="1 2 3 4"'), "r.xml:4: <joint> pos='1 2 3 4' has 4 numbers instead of 3"),
    "limits of a ball": (hinge('type="ball" range="0 30"'), "r.xml:4: joint 'j': limits of a ball joint are not"),
    "spring of a ball": (hinge('type="ball" stiffness="1"'), "r.xml:4: joint 'j': the spring of a ball joint"),
    "spring by time": (hinge('springdamper="1 1"'), "r.xml:4: joint 'j': springdamper is not supported"),
    "one-sided effort": (
        hinge('actuatorfrcrange="0 1"'),
        "r.xml:4: <joint> actuatorfrcrange 0 1: only a symmetric range",
    ),
    "free joint below": (hinge('type="free"'), "r.xml:4: joint 'j' is floating: only the first joint"),
    "free joint and another": (file('<joint name="j"/>'), "r.xml:3: body 'a' has a free joint and others"),
    "free joint with the defaults of others": (
        file().replace("<freejoint/>", '<joint type="free" armature="1"/>'),
        "r.xml:3: a free joint with armature is not supported: use <freejoint>",
    ),
    "two joints of one name": (hinge("", '<joint name="j" axis="1 0 0"/><geom size="1"/>'), "joint name 'j' is taken"),
    "two bodies of one name": (file('<body name="a"><geom size="1"/></body>'), "link name 'a' is taken"),
    "gravity compensated": (file('<body name="b" gravcomp="1"/>'), "r.xml:4: body 'b': gravcomp is not supported"),
    "mocap": (file('<body name="b" mocap="true"/>'), "r.xml:4: body 'b': a mocap body is no part of a robot"),
    "massless": (hinge("", ""), "r.xml:4: link 'b' moves but has neither"),
    "no size": (file('<geom type="box"/>'), "r.xml:4: <geom> has no size"),
    "too few sizes": (file('<geom type="box" size="1 1"/>'), "r.xml:4: <geom> size='1 1' has 2 numbers instead of 3"),
    "negative size": (file('<geom size="-1"/>'), "r.xml:4: <geom> sphere size -1 must be positive"),
    "plane on a body": (file('<geom type="plane" size="1 1 1"/>'), "r.xml:4: <geom> type='plane': known: sphere"),
    "sphere from to": (file('<geom size="1" fromto="0 0 0 1 1 1"/>'), "r.xml:4: a sphere cannot have fromto"),
    "coinciding ends": (
        file('<geom type="capsule" size="1" fromto="1 1 1 1 1 1"/>'),
        "r.xml:4: <geom> fromto='1 1 1 1 1 1': the two points coincide",
    ),
    "two orientations": (
        file('<geom size="1" quat="1 0 0 0" zaxis="0 0 1"/>'),
        "r.xml:4: <geom> has both quat and zaxis",
    ),
    "no orientation": (file('<geom size="1" zaxis="0 0 0"/>'), "r.xml:4: <geom> zaxis='0 0 0' is no orientation"),
    "ellipsoid that touches": (file('<geom type="ellipsoid" size="1 1 1"/>'), "r.xml:4: an ellipsoid is no collision"),
    "shell": (file('<geom size="1" shellinertia="true"/>'), "r.xml:4: <geom> shellinertia is not supported"),
    "negative friction": (file('<geom size="1" friction="-1"/>'), "r.xml:4: <geom> friction -1 must not be negative"),
    "unknown material": (file('<geom size="1" material="x"/>'), "r.xml:4: material 'x' is not in <asset>"),
    "unknown mesh": (file('<geom type="mesh" mesh="x"/>'), "r.xml:4: mesh 'x' is not in <asset>"),
    "no mesh file": (set_up('<asset><mesh file="x.stl"/></asset>'), "r.xml:2: mesh file 'x.stl' does not exist"),
    "two inertials": (
        file(*['<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'] * 2),
        "r.xml:5: body 'a' has more than one <inertial>",
    ),
    "negative inertia": (
        file('<inertial pos="0 0 0" mass="1" diaginertia="-1 1 1"/>'),
        "r.xml:4: body 'a': no rigid body has this inertia",
    ),
    "impossible inertia": (
        file('<inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>'),
        "r.xml:4: body 'a': no rigid body has this inertia",
    ),
    "zero mass": (
        file('<inertial pos="0 0 0" mass="0" diaginertia="1 1 1"/>'),
        "r.xml:4: body 'a': mass 0 kg must be positive",
    ),
    "unknown joint": (driven('<motor name="m" joint="k" ctrlrange="-1 1"/>'), "actuator 'm': joint 'k' does not exist"),
    "unlimited control": (driven('<motor name="m" joint="j"/>'), "r.xml:6: actuator 'm': its control is not limited"),
    "muscle": (driven('<muscle name="m" joint="j"/>'), "r.xml:6: actuator 'm': <muscle> is not supported"),
    "tendon": (driven('<motor name="m" tendon="t"/>'), "r.xml:6: actuator 'm' acts on tendon: give one joint"),
    "torque on a site": (
        driven('<motor name="m" site="s" gear="0 0 0 1 0 0" ctrlrange="-1 1"/>'),
        "r.xml:6: actuator 'm': a site takes a force",
    ),
    "one-sided force": (
        driven('<motor name="m" joint="j" ctrlrange="-1 1" forcerange="-1 2"/>'),
        "r.xml:6: <motor> forcerange -1 2: only a symmetric range",
    ),
    "slow actuator": (
        driven('<position name="m" joint="j" ctrlrange="-1 1" timeconst="1"/>'),
        "r.xml:6: actuator 'm': timeconst is not supported",
    ),
    "unstable servo": (
        driven('<position name="m" joint="j" kp="-1" ctrlrange="-1 1"/>'),
        "r.xml:6: actuator 'm': its force grows with the joint's position",
    ),
    "integrating actuator": (
        driven('<general name="m" joint="j" dyntype="integrator" ctrlrange="-1 1"/>'),
        "r.xml:6: actuator 'm': dyntype='integrator' is not supported",
    ),
    "actuators of one name": (
        driven('<motor name="m" joint="j" ctrlrange="-1 1"/>' * 2),
        "r.xml:6: actuator name 'm' is taken already",
    ),
    "unknown site": (
        driven("", sensor='<gyro name="g" site="t"/>'),
        "sensor 'g': site 't' does not exist on the robot",
    ),
    "ball sensor on a hinge": (
        driven("", sensor='<ballquat name="g" joint="j"/>'),
        "sensor 'g': there is no ball joint",
    ),
    "clipped sensor": (
        driven("", sensor='<gyro name="g" site="s" cutoff="1"/>'),
        "sensor 'g': cutoff is not supported",
    ),
    "touch in a box": (
        driven("", sensor='<touch name="g" site="s"/>').replace('<site name="s"', '<site name="s" type="box"'),
        "r.xml:4: sensor 'g' feels within a site that is no sphere",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_fault(tmp_path: Path, case: str) -> None:
    text, expected = FAULTS[case]
    with pytest.raises(ModelError) as caught:
        read(tmp_path, text)
    lines = str(caught.value).replace(f"{tmp_path}/", "").splitlines()
    assert any(expected in line for line in lines), lines
    assert len(lines) == 1 or case == "two bodies of one name", "one fault is reported once"


@pytest.mark.parametrize(
    ("text", "kind"), [(PLANAR, "floating"), (TEXT, "planar"), (TEXT, "fixed")], ids=["joints", "free", "free fixed"]
)
def test_a_side_file_that_contradicts_the_joints(tmp_path: Path, text: str, kind: str) -> None:
    with pytest.raises(ModelError, match=rf"contradict base\.kind = '{kind}' in robot\.toml"):
        read(tmp_path, text, f'base.kind = "{kind}"')


def test_a_planar_base_in_another_order_is_refused(tmp_path: Path) -> None:
    x, yaw, y = (
        '<joint name="x" type="slide" axis="1 0 0"/>',
        '<joint name="yaw"/>',
        '<joint name="y" type="slide" axis="0 1 0"/>',
    )
    text = f'<mujoco><worldbody><body name="b">{x}{yaw}{y}<geom size="0.1"/></body></worldbody></mujoco>'
    with pytest.raises(ModelError, match="slide 1 0 0, slide 0 1 0, hinge 0 0 1, in this order"):
        read(tmp_path, text, 'base.kind = "planar"')


def test_all_faults_of_both_files_are_reported_at_once(tmp_path: Path) -> None:
    text = hinge('axis="0 0 0" damping="-1"', '<geom size="-1"/><geom/>')
    with pytest.raises(ModelError) as caught:
        read(tmp_path, text, "timestep = -1")
    lines = str(caught.value).splitlines()
    assert len(lines) == 6, lines  # axis, damping, size, no size, timestep, and no mass is left


def test_a_mesh_that_is_not_convex_needs_to_say_what_is_solid(tmp_path: Path) -> None:
    import trimesh

    trimesh.creation.annulus(0.5, 1.0, 0.5).export(tmp_path / "ring.obj")
    text = set_up('<asset><mesh file="ring.obj"/></asset>').replace(
        '<geom size="0.1" />', '<geom type="mesh" mesh="ring"/>'
    )
    with pytest.raises(ModelError, match=r"r\.xml:4: mesh 'ring' has no clear mass: it is not convex"):
        read(tmp_path, text)
