"""What is special to MuJoCo; that it keeps the contract is shown by the conformance suite."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.model.kinematics import Kinematics
from guard_api.model.library import load_robot
from guard_api.model.robot import Actuator, Collision, Home, Joint, Link, RobotModel
from guard_api.scene.spec import BodyGroup, BodySpec, SceneSpec
from guard_api.scene.start import home_start, place_robot
from guard_api.shapes import Box, Mesh, Pose, Sphere
from guard_api.testing.robots import floating_body, floating_tree, planar_point, three_link_arm, touch_sensor

mujoco = pytest.importorskip("mujoco")
guard_mujoco = pytest.importorskip("guard_mujoco")
kernels = pytest.importorskip("guard_mujoco.kernels")
backend = guard_mujoco.backend

RIGID_STIFFNESS = 0.04  # share of the impact speed that a contact's spring may add

EVERY = np.ones(1, bool)
CUBE = Box(half_extents=(0.1, 0.1, 0.1))


def build(scene, num_worlds=1, **kwargs):
    return backend.build(scene, num_worlds, **kwargs)


def body(physics, shape=CUBE, **values):
    return BodySpec(shape=shape, physics=physics, mass=1.0 if physics == "dynamic" else 0.0, height=0.1, **values)


def run(world, start, steps, control=None, substeps=10):
    """Reset to `start` and step under a constant control; return the last state."""
    world.reset(np.ones(world.num_worlds, bool), start)
    if control is None:
        control = np.zeros((world.num_worlds, len(world.scene.robot.actuators) if world.scene.robot else 0))
    for _ in range(steps):
        world.step(np.atleast_2d(control), substeps)
    return world.state()


@pytest.mark.parametrize(("control", "speed", "turn"), [((1.0, 0.0), 1.5, 0.0), ((0.0, 1.0), 0.0, 3.0)])
def test_point_reaches_guards_speeds(control, speed, turn):
    scene = SceneSpec(robot=load_robot("point"))
    state = run(build(scene), home_start(scene, 1), 300, control)
    # Point turns about its centre of mass, 19 mm ahead of its frame.
    assert np.linalg.norm(state.link_linear_velocity[0, 3]) == pytest.approx(speed, rel=0.01, abs=0.0193 * turn)
    assert state.joint_velocity[0, 2] == pytest.approx(turn, rel=0.01, abs=0.01)


def chain_robot(kinds, *, base="fixed"):
    """A robot of one heavy link at the end of massless ones, every joint frame turned and shifted."""
    rng = np.random.default_rng(5)
    names = ["ground", *(f"massless{i}" for i in range(len(kinds) - 1)), "tip"]
    joints = []
    for i, kind in enumerate(kinds):
        axis, quaternion = rng.normal(size=3), rng.normal(size=4)
        origin = Pose(position=tuple(rng.normal(size=3)), quaternion=tuple(quaternion / np.linalg.norm(quaternion)))
        joints.append(
            Joint(
                name=f"j{i}",
                kind=kind,
                parent=names[i],
                child=names[i + 1],
                origin=origin,
                axis=tuple(axis / np.linalg.norm(axis)),
            )
        )
    tip = Link(name="tip", mass=1.0, com=(0.1, 0.2, -0.1), inertia=((0.02, 0, 0), (0, 0.03, 0), (0, 0, 0.04)))
    links = (*(Link(name=name, mass=0.0) for name in names[:-1]), tip)
    return RobotModel(name="chain", base=base, root="tip", links=links, joints=tuple(joints), actuators=())


CHAINS = [
    ("prismatic", "prismatic", "revolute"),
    ("prismatic", "revolute", "prismatic"),
    ("revolute",) * 3,
    ("prismatic",) * 3 + ("revolute",) * 3,
]


@pytest.mark.parametrize("base", ["fixed", "planar"])
@pytest.mark.parametrize("kinds", CHAINS)
def test_merged_joints_keep_the_model_kinematics(kinds, base):
    robot = chain_robot(kinds, base=base)
    scene = SceneSpec(robot=robot, ground=False)
    rng = np.random.default_rng(1)
    start = replace(
        home_start(scene, 3),
        joint_position=rng.normal(size=(3, len(kinds))),
        joint_velocity=rng.normal(size=(3, len(kinds))),
    )
    if base == "fixed":
        quaternion = rng.normal(size=(3, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        start = replace(start, base_position=rng.normal(size=(3, 3)), base_quaternion=quaternion)
    state = run(build(scene, 3), start, 7)
    kinematics = Kinematics(robot)
    poses = kinematics.poses(start.base_position, start.base_quaternion, state.joint_position)
    linear, angular = kinematics.velocities(poses, np.zeros((3, 3)), np.zeros((3, 3)), state.joint_velocity)
    np.testing.assert_allclose(state.link_position, poses.position, atol=1e-13)
    same = np.abs(np.sum(state.link_quaternion * poses.quaternion, axis=-1))
    np.testing.assert_allclose(same, 1.0, atol=1e-13)
    np.testing.assert_allclose(state.link_linear_velocity, linear, atol=1e-12)
    np.testing.assert_allclose(state.link_angular_velocity, angular, atol=1e-12)


def test_a_massless_link_with_two_joints_is_refused():
    robot = chain_robot(("revolute", "revolute"))
    twig = replace(robot.links[-1], name="twig")
    extra = replace(robot.joints[-1], name="extra", child="twig")
    robot = replace(robot, links=(*robot.links, twig), joints=(*robot.joints, extra))
    with pytest.raises(BackendError, match="massless link 'massless0' carries 2 joints"):
        build(SceneSpec(robot=robot))


def test_fixed_base_moves_as_if_the_world_were_turned():
    robot = three_link_arm()
    scene = SceneSpec(robot=robot, ground=False)
    yaw = np.array([0.0, 2.0])
    start = place_robot(robot, home_start(scene, 2), np.array([[0.0, 0.0], [3.0, -1.0]]), yaw)
    state = run(build(scene, 2), start, 50, np.full((2, 3), 0.5))
    np.testing.assert_allclose(state.joint_position[1], state.joint_position[0], atol=1e-9)
    turn = rotations.yaw_quaternion(2.0)
    local = state.link_position[0] - start.base_position[0]
    np.testing.assert_allclose(
        state.link_position[1], start.base_position[1] + rotations.rotate(turn, local), atol=1e-9
    )
    np.testing.assert_allclose(
        state.link_linear_velocity[1], rotations.rotate(turn, state.link_linear_velocity[0]), atol=1e-8
    )


def test_planar_base_must_start_at_the_identity():
    scene = SceneSpec(robot=planar_point())
    start = replace(home_start(scene, 1), base_position=np.array([[0.0, 0.0, 0.1]]))
    with pytest.raises(BackendError, match=r"Start\.base_position must be zero for the planar base.* 0\.1"):
        build(scene).reset(EVERY, start)


def driven_scene(robot=None):
    plough, box = body("driven", friction=0.5), body("dynamic", friction=0.5)
    groups = (BodyGroup(name="plough", body=plough, count=1), BodyGroup(name="box", body=box, count=1))
    return SceneSpec(robot=robot, groups=groups)


def test_a_driven_body_pushes_at_its_speed_and_is_not_slowed_down():
    scene = driven_scene()
    start = home_start(scene, 1)
    start.body_position[0, :, 0] = [0.0, 0.21]
    world = build(scene)
    world.reset(EVERY, start)
    trail = []
    for k in range(1, 76):
        goal = np.array([[[0.3 * 0.02 * k, 0.0, 0.1]]])
        world.drive("plough", goal, np.array([[[1.0, 0.0, 0.0, 0.0]]]))
        world.step(np.zeros((1, 0)), 10)
        state = world.state()
        np.testing.assert_allclose(state.body_position[0, 0], goal[0, 0], atol=1e-6)
        trail.append(state.body_position[0, 1, 0])
    assert (trail[-1] - trail[-51]) / (50 * 0.02) == pytest.approx(0.3, rel=0.01)
    assert trail[-1] - goal[0, 0, 0] == pytest.approx(0.2, abs=2e-3)


def test_a_driven_body_holds_against_gravity_and_a_falling_box():
    scene = driven_scene()
    start = home_start(scene, 1)
    start.body_position[0, :, 2] = [1.0, 1.5]
    state = run(build(scene), start, 100)
    np.testing.assert_allclose(state.body_position[0, 0], [0.0, 0.0, 1.0], atol=1e-6)
    assert state.body_position[0, 1, 2] == pytest.approx(1.2, abs=1e-3)


@pytest.mark.parametrize(("group", "message"), [("box", "not driven"), ("bulldozer", "no group")])
def test_only_driven_groups_are_driven(group, message):
    with pytest.raises(BackendError, match=message):
        build(driven_scene()).drive(group, np.zeros((1, 1, 3)), np.zeros((1, 1, 4)))


@pytest.mark.parametrize("sensors", [(), (touch_sensor("body"),)])
def test_a_nan_is_noticed_frozen_and_leaves_no_file(tmp_path, monkeypatch, sensors):
    monkeypatch.chdir(tmp_path)
    scene = SceneSpec(robot=replace(floating_body(), sensors=sensors))
    start, world = home_start(scene, 3), build(scene, 3, threads=2)
    world.reset(np.ones(3, bool), start)
    world.step(np.zeros((3, 2)), 5)
    before = world.state()
    # Past MuJoCo's own bound on velocities, behind the contract's back: the engine itself must be seen to give up.
    world._qvel[1, 2] = 1e12
    for _ in range(2):
        world.step(np.zeros((3, 2)), 5)
    state = world.state()
    assert state.ok.tolist() == [True, False, True]
    assert np.isfinite(state.link_position).all()
    assert state.time[1] == before.time[1]
    assert state.time[0] > before.time[0]
    assert list(tmp_path.iterdir()) == []
    world.reset(np.array([False, True, False]), start)
    assert world.state().ok.all()


def test_touch_leaves_out_what_the_robot_does_to_itself():
    """Two arms pressed together by their motors feel nothing."""
    whole = tuple(touch_sensor(link) for link in ("left_lower", "right_lower"))
    ends = tuple(replace(sensor, name=f"end_{sensor.link}", radius=0.3) for sensor in whole)
    robot = replace(floating_tree(), sensors=(*whole, *ends))
    scene = SceneSpec(robot=robot, gravity=(0.0, 0.0, 0.0))
    press = np.array([-1.0, 0.0, 1.0, 0.0])
    world = build(scene)
    state = run(world, home_start(scene, 1), 100, press)
    assert (world._batch.get_data(0).sensordata[:4] > 0.1).all()  # the engine's own touch sensors feel it
    assert state.touch.tolist() == [[0.0] * 4]


def test_touching_robot_links_are_told_from_bodies():
    scene = SceneSpec(
        robot=replace(floating_body(thrusters=False), sensors=(touch_sensor("body"),)),
        groups=(
            BodyGroup(name="near", body=body("dynamic"), count=1),
            BodyGroup(name="far", body=body("static"), count=1),
        ),
    )
    start = home_start(scene, 1)
    start.base_position[0, 2] = 0.52
    start.body_position[0, :, 0] = [0.0, 5.0]
    state = run(build(scene), start, 20)
    assert state.body_contact.tolist() == [[True, False]]


@pytest.mark.parametrize("restitution", [0.3, 0.7, 0.95])
def test_restitution_is_newtons_also_for_a_body_that_slides(restitution):
    """The tangential velocity is not turned around: a ball that also moves sideways bounces straight on."""
    ball = body("dynamic", Sphere(radius=0.1), friction=0.0, restitution=restitution)
    scene = SceneSpec(robot=None, groups=(BodyGroup(name="ball", body=ball, count=1),), gravity=(0.0, 0.0, 0.0))
    start = home_start(scene, 1)
    start.body_position[0, 0, 2] = 0.11
    start.body_linear_velocity[0, 0] = [0.5, 0.0, -1.0]
    state = run(build(scene), start, 5)
    np.testing.assert_allclose(state.body_linear_velocity[0, 0], [0.5, 0.0, restitution], atol=RIGID_STIFFNESS)


def test_of_two_moving_bodies_the_more_elastic_decides():
    ball = Sphere(radius=0.1)
    groups = tuple(BodyGroup(name=f"b{e}", body=body("dynamic", ball, restitution=e), count=1) for e in (0.0, 0.8))
    scene = SceneSpec(robot=None, groups=groups, ground=False, gravity=(0.0, 0.0, 0.0))
    start = home_start(scene, 1)
    start.body_position[0, :, 0] = [0.0, 0.22]
    start.body_linear_velocity[0, :, 0] = [1.0, 0.0]
    velocity = run(build(scene), start, 5).body_linear_velocity[0, :, 0]
    assert velocity[1] - velocity[0] == pytest.approx(0.8, abs=1.01 * RIGID_STIFFNESS)


def test_mesh_bodies_stand_where_their_hull_does():
    """A cube given as a mesh away from its origin rests on the floor like the cube, its frame at its centre of mass."""
    corners = tuple((0.3 + x, y, z) for x, y, z in product((-0.1, 0.1), repeat=3))
    mesh = Mesh(vertices=corners, source="cube")
    link = Link(
        name="block",
        mass=1.0,
        com=(0.3, 0.0, 0.0),
        inertia=((0.01, 0, 0), (0, 0.01, 0), (0, 0, 0.01)),
        collisions=(Collision(shape=mesh),),
    )
    robot = RobotModel(name="block", base="floating", root="block", links=(link,), joints=(), actuators=())
    scene = SceneSpec(robot=robot, groups=(BodyGroup(name="cube", body=body("dynamic", mesh), count=1),))
    start = home_start(scene, 1)
    start.base_position[0, 2] = 0.11
    start.body_position[0, 0] = [0.0, 1.0, 0.11]
    world = build(scene)
    state = run(world, start, 100)
    np.testing.assert_allclose(state.link_position[0, 0], [0.0, 0.0, 0.1], atol=1e-3)
    np.testing.assert_allclose(state.body_position[0, 0], [0.0, 1.0, 0.1], atol=1e-3)
    assert world.inspect(0).body_mass.tolist() == [1.0]


def test_an_effort_limit_on_one_servo_does_not_clip_thrust():
    """A joint's effort limit binds its own actuators; MuJoCo's would also bind what thrusters do to the joint."""
    arm = three_link_arm()
    thruster = Actuator(name="jet", law="thrust", link="upper", gear=1.0)
    both = Actuator(name="extra", law="effort", joint="shoulder")
    scene = SceneSpec(robot=replace(arm, actuators=(*arm.actuators, thruster)))
    assert not build(scene)._batch.model.jnt_actfrclimited.any()
    with pytest.raises(BackendError, match="effort_limit binds shoulder, extra together"):
        build(SceneSpec(robot=replace(arm, actuators=(*arm.actuators, thruster, both))))


def sledge(kind):
    """A flat box under a light body, on a joint that moves it along the body's vertical, or about it: 2 kg in all."""
    limits = {"revolute": (-0.5, 0.5), "prismatic": (-0.5, 0.5), "continuous": None}[kind]
    inertia = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
    shape = Collision(shape=Box(half_extents=(0.2, 0.2, 0.02)), friction=0.8)
    return RobotModel(
        name="sledge", base="floating", root="top", actuators=(),
        links=(
            Link(name="top", mass=1.0, inertia=inertia),
            Link(name="runner", mass=1.0, inertia=inertia, collisions=(shape,)),
        ),
        joints=(Joint(name="j", kind=kind, parent="top", child="runner", axis=(0.0, 0.0, 1.0), limits=limits),),
        home=Home(height=0.02),
    )  # fmt: skip


@pytest.mark.parametrize(("kind", "limb"), [("revolute", True), ("continuous", False), ("prismatic", False)])
def test_limbs_stop_slipping_at_once_and_all_else_takes_its_time(kind, limb):
    """Coulomb's friction stops a slip of 0.1 m/s within 13 ms; of wheels, and of what slides, MuJoCo's is slower."""
    scene = SceneSpec(robot=sledge(kind), timestep=0.004)
    start = home_start(scene, 1)
    start.base_linear_velocity[0, 0] = 0.1
    speed = run(build(scene), start, 1, substeps=4).link_linear_velocity[0, 1, 0]
    assert abs(speed) < 0.005 if limb else 0.015 < speed < 0.05


def test_native_keeps_the_engines_contacts():
    scene = SceneSpec(robot=floating_body())
    rigid, native = (build(replace(scene, preset=preset))._batch.model for preset in ("rigid", "native"))
    default = mujoco.MjModel.from_xml_string("<mujoco/>").opt
    assert (native.opt.cone, native.opt.impratio) == (default.cone, default.impratio)
    np.testing.assert_array_equal(native.pair_solref, [[0.02, 1.0]])
    np.testing.assert_array_equal(native.pair_solimp, [[0.9, 0.95, 0.001, 0.5, 2.0]])
    assert rigid.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC


def test_what_the_compiler_refuses_is_a_backend_error():
    robot = floating_body()
    flat = replace(robot.links[0], inertia=((1.0, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))
    with pytest.raises(BackendError, match=r"MuJoCo cannot build the scene of floating_body.*inertia"):
        build(SceneSpec(robot=replace(robot, links=(flat,))))


def test_a_closed_world_says_so():
    world = build(SceneSpec(robot=planar_point()))
    world.close()
    world.close()
    with pytest.raises(BackendError, match="closed"):
        world.state()


@pytest.mark.parametrize("form", ["compiled", "plain"])
@pytest.mark.parametrize("fault", ["nothing", "NaN", "speed", "warning", "not ok"])
def test_any_disturbance_of_any_world_is_seen_and_efforts_of_sound_ones_are_taken(form, fault):
    pytest.importorskip("numba")
    read = kernels.aftermath() if form == "compiled" else guard_mujoco.aftermath._read
    force, effort = np.array([[1.0, 2.0, -7.0]] * 3), np.full((3, 3), 9.0)
    servos, limit = np.array([[0, 1, 2], [0, 0, 2]]), np.array([2.5, np.inf, np.inf])  # two on the first joint
    qvel, warning, ok, verdict = np.ones((3, 4))[:, ::2], np.zeros((3, 7, 2), np.int32), np.ones(3, bool), EVERY.copy()
    match fault:
        case "NaN":
            qvel[1, 1] = np.nan
        case "speed":
            qvel[1, 1] = 10.0
        case "warning":
            warning[2, 6, 1] = 1
        case "not ok":
            ok[2] = False
    read(qvel, warning, force, servos, limit, ok, 100.0, effort, verdict)
    assert verdict[0] == (fault == "nothing")
    np.testing.assert_array_equal(effort[ok], [[2.5, 0.0, -7.0]] * ok.sum())
    np.testing.assert_array_equal(effort[~ok], 9.0)
