"""The `ideal` backend: exact laws, independent worlds, exact snapshots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.model.dynamics import Dynamics
from guard_api.model.robot import RobotModel
from guard_api.physics.backend import Backend, World
from guard_api.scene.spec import BodyGroup, SceneSpec
from guard_api.scene.start import home_start
from guard_api.testing import robots
from guard_api.testing.ideal import backend
from guard_api.testing.ideal.friction import rubbed
from guard_api.testing.ideal.stops import inelastic
from guard_api.testing.ideal.world import IdealWorld
from tests.physics.scenes import BOX, GREMLIN, begin, bits, busy_scene, run


def started(robot: RobotModel | None, num_worlds: int = 1, *, joints: list[float] | None = None, **scene) -> IdealWorld:
    spec = SceneSpec(robot=robot, **scene)
    start = home_start(spec, num_worlds)
    if joints:
        start.joint_position[:] = joints
    world = backend.build(spec, num_worlds)
    world.reset(np.ones(num_worlds, bool), start)
    return world


def test_it_has_the_shape_of_a_backend() -> None:
    assert isinstance(backend, Backend)
    assert isinstance(backend.build(busy_scene(), 1), World)


@pytest.mark.parametrize("num_worlds", [1, 2, 7])
def test_worlds_do_not_depend_on_how_many_there_are(num_worlds: int) -> None:
    many, few = backend.build(busy_scene(), 64), backend.build(busy_scene(), num_worlds)
    for world in (many, few):
        begin(world)
    assert bits(run(many, 4), slice(num_worlds)) == bits(run(few, 4))


def test_a_pendulum_keeps_its_energy() -> None:
    """Semi-implicit Euler keeps the energy m l^2 qd^2 / 2 - m g l cos q bounded, to first order in the timestep."""
    inertia = 1.0 + 0.4 * 0.1**2
    drift = []
    for timestep in (4e-3, 1e-3):
        world = started(robots.pendulum(), joints=[2.0], timestep=timestep)
        energies = []
        for _ in range(16):
            state = world.state()
            q, qd = state.joint_position[0, 0], state.joint_velocity[0, 0]
            energies.append(0.5 * inertia * qd**2 - 9.81 * np.cos(q))
            world.step(np.zeros((1, 1)), round(0.064 / timestep))
        drift.append(np.ptp(energies))
    assert drift[0] < 0.02 * 2 * 9.81
    assert 0.2 < drift[1] / drift[0] < 0.3


def test_a_position_servo_settles_at_its_target() -> None:
    world = started(robots.three_link_arm(), gravity=(0.0, 0.0, 0.0), timestep=0.01)
    world.step(np.array([[0.0, 0.7, 0.0]]), 500)
    state = world.state()
    np.testing.assert_allclose(state.joint_position[0, 1], 0.7, atol=1e-3)
    np.testing.assert_allclose(state.joint_velocity[0, 1], 0.0, atol=1e-3)


def test_a_joint_stops_at_its_limit() -> None:
    world = started(robots.slider(limits=(-0.2, 0.3)), timestep=0.002)
    for _ in range(15):
        world.step(np.array([[1.0]]), 40)
        assert world.state().joint_position[0, 0] <= 0.3
    state = world.state()
    assert state.joint_position[0, 0] == 0.3
    assert state.joint_velocity[0, 0] == 0.0
    world.step(np.array([[-1.0]]), 100)
    assert world.state().joint_position[0, 0] < 0.3


def test_the_whole_robot_feels_a_stop() -> None:
    """A knee that meets its stop drags hip and body along: linear momentum stays."""
    free = robots.floating_tree()
    knee = free.joint_index("left_knee")
    joints = tuple(replace(joint, armature=0.0) for joint in free.joints)
    joints = (*joints[:knee], replace(joints[knee], kind="revolute", limits=(-1.0, 0.0035)), *joints[knee + 1 :])
    robot = replace(free, joints=joints)
    spec = SceneSpec(robot=robot, gravity=(0.0, 0.0, 0.0), timestep=0.001)
    start = home_start(spec, 1)
    start.joint_velocity[:, knee] = 2.0
    world = backend.build(spec, 1)
    world.reset(np.ones(1, bool), start)
    momenta, speeds = [], []
    for _ in range(4):
        state = world.state()
        com = rotations.rotate(state.link_quaternion, np.array([link.com for link in robot.links]))
        velocity = state.link_linear_velocity + np.cross(state.link_angular_velocity, com)
        momenta.append(np.array([link.mass for link in robot.links]) @ velocity[0])
        speeds.append(state.joint_velocity[0])
        world.step(np.zeros((1, 4)), 1)
    assert world.state().joint_position[0, knee] == 0.0035
    np.testing.assert_allclose(world.state().joint_velocity[0, knee], 0.0, atol=1e-9)
    hip = free.joint_index("left_hip")
    assert abs(speeds[1][hip]) < 1e-2 < abs(world.state().link_angular_velocity[0, 0]).max()
    # To first order in the timestep: the base's velocity is integrated, not the momentum.
    np.testing.assert_allclose(momenta[-1], momenta[0], atol=2e-3 * np.abs(momenta[0]).max())


def test_stops_only_push() -> None:
    """Two masses on a line, coupled: the row that is held takes the free one along until that meets its own bound."""
    matrix, free = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-1.0, 0.0])
    alone = inelastic(matrix, free, np.array([[1.0, 0.0]]), np.zeros(1))
    np.testing.assert_allclose(alone, [0.0, -0.5])  # an impulse p: p (2/3, -1/3) with p = 3/2
    both = inelastic(matrix, free, np.eye(2), np.zeros(2))
    np.testing.assert_allclose(both, [0.0, 0.0], atol=1e-15)
    let_go = inelastic(matrix, np.array([-1.0, 1.0]), np.eye(2), np.zeros(2))
    np.testing.assert_allclose(let_go, [0.0, 0.5])
    np.testing.assert_array_equal(inelastic(matrix, -free, np.eye(2), np.zeros(2)), -free)


def test_a_planar_robot_moves_through_its_base_joints() -> None:
    """A force F on mass m with damping d: v approaches F / d as 1 - (1 + h d / m)^-n."""
    world = started(robots.planar_point(), timestep=0.002)
    world.step(np.array([[1.0, 0.0, 0.0]]), 500)
    state = world.state()
    np.testing.assert_allclose(state.joint_velocity[0, 0], 10.0 * (1 - (1 + 0.002 * 0.1) ** -500), rtol=1e-12)
    np.testing.assert_allclose(state.link_position[0, 3], [state.joint_position[0, 0], 0.0, 0.1], rtol=1e-12)


def test_bodies_fall_spin_and_keep_their_angular_momentum() -> None:
    scene = SceneSpec(robot=None, groups=(BodyGroup(name="box", body=BOX, count=1),), timestep=1e-3)
    world = backend.build(scene, 1)
    start = home_start(scene, 1)
    start.body_angular_velocity[:] = [1.0, 5.0, 0.5]
    world.reset(np.ones(1, bool), start)
    inertia = np.diag([0.4**2 + 0.6**2, 0.2**2 + 0.6**2, 0.2**2 + 0.4**2]) * 2.0 / 12.0

    def momentum() -> np.ndarray:
        state = world.state()
        R = rotations.to_matrix(state.body_quaternion[0, 0])
        return R @ inertia @ R.T @ state.body_angular_velocity[0, 0]

    before = momentum()
    world.step(np.zeros((1, 0)), 500)
    state = world.state()
    np.testing.assert_allclose(momentum(), before, rtol=1e-10)
    np.testing.assert_allclose(state.body_linear_velocity[0, 0], [0.0, 0.0, -9.81 * 0.5], rtol=1e-12)
    np.testing.assert_allclose(state.body_position[0, 0, 2], 1.0 - 9.81 * 1e-6 * 500 * 501 / 2, rtol=1e-12)
    assert abs(state.body_angular_velocity[0, 0] - [1.0, 5.0, 0.5]).max() > 0.1


def test_driven_bodies_arrive_with_the_velocity_that_took_them_there() -> None:
    scene = SceneSpec(robot=None, groups=(BodyGroup(name="gremlins", body=GREMLIN, count=1),), timestep=0.01)
    world = backend.build(scene, 1)
    world.reset(np.ones(1, bool), home_start(scene, 1))
    target = np.array([[[1.0, 2.0, 0.1]]])
    world.drive("gremlins", target, rotations.yaw_quaternion(np.array([[0.5]])))
    world.step(np.zeros((1, 0)), 10)
    state = world.state()
    np.testing.assert_array_equal(state.body_position, target)
    np.testing.assert_allclose(state.body_linear_velocity[0, 0], [10.0, 20.0, 0.0], rtol=1e-12)
    np.testing.assert_allclose(state.body_angular_velocity[0, 0], [0.0, 0.0, 5.0], atol=1e-12)
    world.step(np.zeros((1, 0)), 10)
    state = world.state()
    np.testing.assert_array_equal(state.body_position, target)
    np.testing.assert_array_equal(state.body_linear_velocity, 0.0)


def test_a_world_that_diverges_says_so_and_keeps_still() -> None:
    world, sound = started(robots.pendulum(), 3), started(robots.pendulum(), 3)
    control = np.array([[0.5], [np.nan], [-0.5]])
    for _ in range(3):
        world.step(control, 4)
        sound.step(np.nan_to_num(control), 4)
    state = world.state()
    assert state.ok.tolist() == [True, False, True]
    assert np.isfinite(state.joint_position).all()
    assert state.time[1] == 0.0
    for i in (0, 2):
        assert bits(state, slice(i, i + 1)) == bits(sound.state(), slice(i, i + 1))
    world.reset(np.array([False, True, False]), home_start(world.scene, 3))
    assert world.state().ok.all()


def test_a_snapshot_holds_everything_that_decides_the_future() -> None:
    world, twin = backend.build(busy_scene(), 3), backend.build(busy_scene(), 3)
    begin(world)
    run(world, 4)
    world.drive("gremlins", np.ones((3, 3, 3)), rotations.yaw_quaternion(np.zeros((3, 3))))
    blob = world.snapshot()
    twin.restore(blob)
    for each in (world, twin):
        each.step(np.full((3, 4), 0.3), 5)
    assert bits(world.state()) == bits(twin.state())


@pytest.mark.parametrize("damage", [lambda b: b[:-1], lambda b: b + b"x", lambda b: b"", lambda b: b[::-1]])
def test_damaged_snapshots_are_refused(damage) -> None:
    world = started(robots.pendulum(), 2)
    with pytest.raises(BackendError, match="not a snapshot"):
        world.restore(damage(world.snapshot()))


def test_inspection_is_the_model() -> None:
    world = started(robots.floating_tree(), 2)
    seen = world.inspect(1)
    assert seen.mass_matrix is not None
    np.testing.assert_allclose(seen.mass_matrix[:3, :3], np.eye(3) * seen.link_mass.sum(), atol=1e-14)
    assert seen.bias_force is not None
    np.testing.assert_allclose(seen.bias_force[:3], [0.0, 0.0, 9.81 * seen.link_mass.sum()], atol=1e-13)


def test_misuse_is_named() -> None:
    world = backend.build(busy_scene(), 2)
    with pytest.raises(BackendError, match=r"control has shape \(4,\)"):
        world.step(np.zeros(4), 1)
    with pytest.raises(BackendError, match="substeps is 0"):
        world.step(np.zeros((2, 4)), 0)
    with pytest.raises(BackendError, match="'boxes' is no group of driven bodies"):
        world.drive("boxes", np.zeros((2, 2, 3)), np.zeros((2, 2, 4)))


def test_dry_friction_holds_still_and_is_overcome() -> None:
    """Under half the friction a joint stays; above it, it gains (effort - friction) / m; then it stops and stays."""
    robot = robots.planar_point()
    rubbing = replace(robot, joints=tuple(replace(j, friction_loss=0.5, damping=0.0) for j in robot.joints))
    world = started(rubbing, 2, timestep=0.002)
    world.step(np.array([[0.25, 0.0, 0.0], [1.0, -1.0, 0.0]]), 100)
    state = world.state()
    np.testing.assert_allclose(state.joint_velocity[0], 0.0, atol=1e-15)
    np.testing.assert_allclose(state.joint_velocity[1, :2], [0.1, -0.1], rtol=1e-9)
    world.step(np.zeros((2, 3)), 120)
    np.testing.assert_allclose(world.state().joint_velocity, 0.0, atol=1e-15)


def test_dry_friction_of_coupled_joints_is_within_its_bounds_and_resists() -> None:
    """Every joint either rests with less than its friction or moves against all of it."""
    robot = robots.double_pendulum()
    dynamics, h = Dynamics(robot), 0.002
    rng = np.random.default_rng(5)
    q, qd = rng.normal(size=(2, 50, 2))
    qd[:25] *= 0.01
    loss = np.array([3.0, 0.5])
    poses = dynamics.kinematics.poses(np.zeros((50, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (50, 1)), q)
    zero = np.zeros((50, 3))
    matrix, right = dynamics.equations(
        poses, zero, zero, qd, effort=np.zeros((50, 2)), thrust=np.zeros((50, 0, 3)), timestep=h
    )  # fmt: skip
    a = rubbed(matrix, right, qd.T, loss, h)
    friction = np.einsum("ijn,jn->ni", matrix, a) - right.T
    after = qd + h * a.T
    at_rest = np.abs(after) < 1e-6
    assert at_rest.any()
    assert (~at_rest).any()
    assert (np.abs(friction) <= loss * (1 + 1e-9)).all()
    np.testing.assert_allclose(friction[~at_rest], (-np.sign(after) * loss)[~at_rest], rtol=1e-6)
