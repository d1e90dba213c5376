"""Reference dynamics against what is known on paper and against derivatives of the energies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from guard_api import rotations
from guard_api.model.dynamics import Dynamics
from guard_api.model.robot import RobotModel
from guard_api.testing import robots

Builder = Callable[[], RobotModel]
FIXED = [robots.pendulum, robots.double_pendulum, robots.slider, robots.three_link_arm, robots.planar_point]
FLOATING = [robots.floating_body, robots.floating_tree]
G = 9.81
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])
ZERO = np.zeros((1, 3))


def at_origin(dynamics: Dynamics, *q: float):
    return dynamics.kinematics.poses(ZERO, UPRIGHT, np.array([q], float))


def random_state(robot: RobotModel, num_worlds: int = 4) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(11)
    position, quaternion = rng.normal(size=(num_worlds, 3)), rng.normal(size=(num_worlds, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    linear, angular = rng.normal(size=(2, num_worlds, 3)) if robot.floating else np.zeros((2, num_worlds, 3))
    q, qd = rng.normal(size=(2, num_worlds, len(robot.joints)))
    return position, quaternion, q, linear, angular, qd


def kinetic_energy(robot: RobotModel, dynamics: Dynamics, state: tuple[np.ndarray, ...]) -> np.ndarray:
    """Sum over links of m v^2 / 2 + w I w / 2, and the rotors': from link velocities alone."""
    position, quaternion, q, linear, angular, qd = state
    poses = dynamics.kinematics.poses(position, quaternion, q)
    v, w = dynamics.kinematics.velocities(poses, linear, angular, qd)
    total = 0.5 * (qd**2) @ np.array([joint.armature for joint in robot.joints])
    for k, link in enumerate(robot.links):
        com = v[:, k] + np.cross(w[:, k], rotations.rotate(poses.quaternion[:, k], link.com))
        spin = rotations.unrotate(poses.quaternion[:, k], w[:, k])
        total += 0.5 * link.mass * (com**2).sum(1) + 0.5 * np.einsum("ni,ij,nj->n", spin, np.array(link.inertia), spin)
    return total


def potential_energy(robot: RobotModel, dynamics: Dynamics, q: np.ndarray) -> np.ndarray:
    n = len(q)
    poses = dynamics.kinematics.poses(np.zeros((n, 3)), np.tile(UPRIGHT, (n, 1)), q)
    heights = [
        poses.position[:, k, 2] + rotations.rotate(poses.quaternion[:, k], link.com)[:, 2]
        for k, link in enumerate(robot.links)
    ]
    return G * np.array([link.mass for link in robot.links]) @ np.array(heights)


def test_pendulum_on_paper() -> None:
    mass, length, armature, angle, speed = 1.3, 0.7, 0.05, 0.4, 1.7
    dynamics = Dynamics(robots.pendulum(mass=mass, length=length, armature=armature))
    poses = at_origin(dynamics, angle)
    inertia = mass * length**2 + 0.4 * mass * 0.1**2
    np.testing.assert_allclose(dynamics.mass_matrix(poses), [[[inertia + armature]]], rtol=1e-14)
    bias = dynamics.bias_force(poses, ZERO, ZERO, np.array([[speed]]))
    np.testing.assert_allclose(bias, [[mass * G * length * np.sin(angle)]], rtol=1e-14)


def test_double_pendulum_on_paper() -> None:
    """Lagrange's equations of two uniform rods, length l, mass m, centre of mass at l / 2."""
    m, length, (a, b), (da, db) = 1.0, 0.5, (0.4, -0.9), (1.1, -2.0)
    rod, half = m * length**2 / 12, length / 2
    outer = rod + m * half**2
    coupling = m * length * half * np.cos(b)
    M = [
        [rod + m * half**2 + outer + m * length**2 + 2 * coupling, outer + coupling],
        [outer + coupling, outer],
    ]
    swing = m * length * half * np.sin(b)
    pull = m * G * half * np.sin(a + b)
    bias = [-swing * (2 * da * db + db**2) + (m * half + m * length) * G * np.sin(a) + pull, swing * da**2 + pull]

    dynamics = Dynamics(robots.double_pendulum())
    poses = at_origin(dynamics, a, b)
    np.testing.assert_allclose(dynamics.mass_matrix(poses)[0], M, rtol=1e-13)
    np.testing.assert_allclose(dynamics.bias_force(poses, ZERO, ZERO, np.array([[da, db]]))[0], bias, rtol=1e-13)


def test_spinning_free_body_obeys_euler() -> None:
    """About the centre of mass: I dw/dt + w x I w = 0, and the centre of mass falls freely."""
    robot = robots.floating_body(thrusters=False)
    position, quaternion, q, linear, angular, qd = random_state(robot)
    dynamics = Dynamics(robot)
    poses = dynamics.kinematics.poses(position, quaternion, q)
    nothing = {"effort": np.zeros((4, 0)), "thrust": np.zeros((4, 0, 3)), "timestep": 0.002}
    a = dynamics.acceleration(poses, linear, angular, qd, **nothing)

    inertia, spin = np.array(robot.links[0].inertia), rotations.unrotate(quaternion, angular)
    expected = rotations.rotate(quaternion, -np.linalg.solve(inertia, np.cross(spin, spin @ inertia).T).T)
    np.testing.assert_allclose(a[:, 3:], expected, atol=1e-12)
    arm = rotations.rotate(quaternion, robot.links[0].com)
    com = a[:, :3] + np.cross(a[:, 3:], arm) + np.cross(angular, np.cross(angular, arm))
    np.testing.assert_allclose(com, np.tile([0.0, 0.0, -G], (4, 1)), atol=1e-12)


@pytest.mark.parametrize("build", FIXED + FLOATING)
def test_mass_matrix_gives_the_kinetic_energy(build: Builder) -> None:
    """T = v M v / 2 for random v, and M is symmetric and positive definite."""
    robot = build()
    dynamics, state = Dynamics(robot), random_state(robot, 16)
    position, quaternion, q, linear, angular, qd = state
    M = dynamics.mass_matrix(dynamics.kinematics.poses(position, quaternion, q))
    v = np.concatenate([linear, angular, qd], axis=1) if robot.floating else qd
    np.testing.assert_allclose(
        0.5 * np.einsum("ni,nij,nj->n", v, M, v), kinetic_energy(robot, dynamics, state), rtol=1e-12
    )
    np.testing.assert_array_equal(M, M.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(M).min() > 0.0


@pytest.mark.parametrize("build", FIXED)
def test_bias_force_is_lagranges(build: Builder) -> None:
    """bias = dM/dt qd - d(qd M qd / 2)/dq + dV/dq, with derivatives by central differences."""
    robot = build()
    dynamics = Dynamics(robot)
    q, qd = random_state(robot, 1)[2][0], random_state(robot, 1)[5][0]
    h = 1e-5
    slopes = []
    potential = np.empty(len(q))
    for i, step in enumerate(h * np.eye(len(q))):
        up, down = (dynamics.mass_matrix(at_origin(dynamics, *q + sign * step))[0] for sign in (1, -1))
        slopes.append((up - down) / (2 * h))
        energies = potential_energy(robot, dynamics, np.array([q + step, q - step]))
        potential[i] = (energies[0] - energies[1]) / (2 * h)
    dM = np.array(slopes)
    expected = np.einsum("kij,k,j->i", dM, qd, qd) - 0.5 * np.einsum("ijk,j,k->i", dM, qd, qd) + potential
    bias = dynamics.bias_force(at_origin(dynamics, *q), ZERO, ZERO, qd[None])[0]
    np.testing.assert_allclose(bias, expected, atol=2e-8)


def test_floating_tree_falls_as_one_and_keeps_its_momentum() -> None:
    """Without contact the centre of mass falls freely, whatever the joints and motors do."""
    robot = robots.floating_tree()
    position, quaternion, q, linear, angular, qd = random_state(robot)
    dynamics = Dynamics(robot)
    poses = dynamics.kinematics.poses(position, quaternion, q)
    effort = np.random.default_rng(0).normal(size=q.shape)
    a = dynamics.acceleration(
        poses, linear, angular, qd, effort=effort, thrust=np.zeros((4, 0, 3)), timestep=0.002
    )  # fmt: skip
    h = 1e-6

    def momentum(time: float) -> np.ndarray:
        rate = np.linalg.norm(angular, axis=1)
        turn = rotations.from_axis_angle(angular / rate[:, None], rate * time)
        there = dynamics.kinematics.poses(
            position + time * linear, rotations.multiply(turn, quaternion), q + time * qd
        )  # fmt: skip
        v, w = dynamics.kinematics.velocities(
            there, linear + time * a[:, :3], angular + time * a[:, 3:6], qd + time * a[:, 6:]
        )
        total = np.zeros((4, 3))
        for k, link in enumerate(robot.links):
            total += link.mass * (v[:, k] + np.cross(w[:, k], rotations.rotate(there.quaternion[:, k], link.com)))
        return total

    weight = sum(link.mass for link in robot.links) * np.array([0.0, 0.0, -G])
    np.testing.assert_allclose((momentum(h) - momentum(-h)) / (2 * h), np.tile(weight, (4, 1)), atol=1e-7)


def test_thrust_pulls_at_its_point() -> None:
    """Force F at point p of a resting free body: m a_com = F, I dw/dt = (p - com) x F."""
    robot = robots.floating_body()
    link, point = robot.links[0], np.array([0.0, 0.2, 0.0])
    dynamics = Dynamics(robot, gravity=(0.0, 0.0, 0.0))
    force = np.array([[[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]])
    a = dynamics.acceleration(
        at_origin(dynamics), ZERO, ZERO, np.zeros((1, 0)), effort=np.zeros((1, 0)), thrust=force, timestep=0.002
    )[0]
    spin = np.linalg.solve(np.array(link.inertia), np.cross(point - np.array(link.com), force[0, 0]))
    np.testing.assert_allclose(a[3:], spin, rtol=1e-12)
    np.testing.assert_allclose(a[:3] + np.cross(spin, link.com), force[0, 0] / link.mass, rtol=1e-12)


def test_acceleration_is_the_documented_law() -> None:
    """(M + h D) a = effort - D qd - bias, with M including armature."""
    robot = robots.three_link_arm()
    position, quaternion, q, linear, angular, qd = random_state(robot)
    dynamics = Dynamics(robot)
    poses = dynamics.kinematics.poses(position, quaternion, q)
    effort, D, h = np.ones_like(q), np.array([joint.damping for joint in robot.joints]), 0.01
    right = effort - D * qd - dynamics.bias_force(poses, linear, angular, qd)
    expected = np.linalg.solve(dynamics.mass_matrix(poses) + h * np.diag(D), right[..., None])[..., 0]
    a = dynamics.acceleration(poses, linear, angular, qd, effort=effort, thrust=np.zeros((4, 0, 3)), timestep=h)
    np.testing.assert_allclose(a, expected, rtol=1e-12)


def test_far_from_the_origin_nothing_is_lost() -> None:
    """A planar robot with light parts a kilometre away has the mass matrix that it has at the origin."""
    robot = robots.planar_point()
    dynamics = Dynamics(robot)
    near = dynamics.mass_matrix(at_origin(dynamics, 0.0, 0.0, 0.3))
    far = dynamics.mass_matrix(at_origin(dynamics, 1000.0, -1000.0, 0.3))
    np.testing.assert_allclose(far, near, rtol=1e-12, atol=1e-15)


def test_a_singular_world_harms_no_other() -> None:
    """A robot without inertia about its axis gets no finite acceleration, and nothing is raised."""
    robot = robots.pendulum()
    hollow = replace(robot.links[1], com=(0.0, 0.0, 0.0), inertia=((0.0,) * 3,) * 3)
    dynamics = Dynamics(replace(robot, links=(robot.links[0], hollow)))
    with np.errstate(all="ignore"):
        a = dynamics.acceleration(
            at_origin(dynamics, 0.0), ZERO, ZERO, np.zeros((1, 1)), effort=np.ones((1, 1)),
            thrust=np.zeros((1, 0, 3)), timestep=0.002,
        )  # fmt: skip
    assert not np.isfinite(a).any()
