"""How any robot moves with nothing around it: actuators, thrusts, armature, energy and fall, one robot at a time.

The reference is the `ideal` backend, which integrates the recursions of the neutral model by semi-implicit Euler. For
a floating base an engine may integrate the velocity of the origin, that of the com or the momentum, which differ by the
first order of the timestep: as much as the reference differs from itself at half the timestep, which is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.dynamics import Dynamics
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import Actuator, RobotModel
from guard_api.physics.backend import Backend
from guard_api.physics.state import State
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, error, rounding, worst
from guard_api.testing.checks.mechanics import INERTIAL, anywhere, reference
from guard_api.testing.ideal.world import IdealBackend
from guard_api.testing.scenes import idle, robot_scene, running

Array = NDArray[np.float64]

G = 9.81
EARTH = (0.0, 0.0, -G)

RESPONSE = 5
"""Timesteps for which an actuator's step response is followed."""

SWING, TIMESTEPS = 0.25, 60
"""Length of a free swing or flight [s], and the most timesteps that it takes."""

BELOW = 0.1
"""Distance from a thrust's ceiling at which a flight begins [m]."""

JOINT_INERTIA = 1e-5
"""Relative tolerance of the inertia of one joint, looser than `INERTIAL`: an engine may keep a chain with massless
links regular by giving them a token of mass, which costs digits where their joints are in line."""

SWING_LOSS = 1e-3
"""Share of the energy of a swing that may be lost besides what a finite timestep explains."""


def changed(robot: RobotModel, **joint: Any) -> RobotModel:
    """Return `robot` with these values on every joint."""
    return replace(robot, joints=tuple(replace(item, **joint) for item in robot.joints))


def driven(robot: RobotModel) -> RobotModel:
    """Return `robot` with a direct drive of every joint, in their order, as its only actuators."""
    names = robot.joint_names
    drives = [Actuator(name=f"drive_{name}", law="effort", joint=name, ctrl_range=(-1e9, 1e9)) for name in names]
    return replace(robot, actuators=tuple(drives))


def inside(robot: RobotModel, share: float = 0.25) -> Array:
    """Return the joint positions (J,) of home, moved away from the limits by `share` of their distance."""
    q = np.array([robot.home.joint_position.get(name, 0.0) for name in robot.joint_names])
    limits = np.array([joint.limits or (-np.inf, np.inf) for joint in robot.joints]).reshape(-1, 2)
    width = np.where(np.isfinite(limits).all(axis=1), share * (limits[:, 1] - limits[:, 0]), 0.0)
    return np.clip(q, limits[:, 0] + width, limits[:, 1] - width)


def played(backend: Backend, scene: SceneSpec, controls: Sequence[Array], substeps: int, **start: Any) -> list[State]:
    """Return the states before and after each of `controls` (N, U), held for `substeps` each, from rest or `start`."""
    with running(backend, scene, len(controls[0]), **start) as world:
        states = [world.state()]
        for control in controls:
            world.step(control, substeps)
            states.append(world.state())
    return states


def velocities(states: Sequence[State], floating: bool) -> Array:
    """Return the velocities (S, N, D) of the coordinates in `states`: those of a floating base, then the joints'."""
    rows = []
    for state in states:
        base = [state.link_linear_velocity[:, 0], state.link_angular_velocity[:, 0]] if floating else []
        rows.append(np.concatenate([*base, state.joint_velocity], axis=1))
    return np.array(rows)


def follows_reference(
    backend: Backend, scene: SceneSpec, controls: Sequence[Array], substeps: int, what: str, **start: Any
) -> list[Finding]:
    """Compare velocities and efforts of a robot in the air with the reference, world by world.

    Errors are relative to the fastest coordinate of the world, and to the largest effort. A thrust may point where its
    link did a timestep ago: that is the angle w h of it.
    """
    robot = scene.robot
    assert robot is not None
    got, expected = (played(engine, scene, controls, substeps, **start)[1:] for engine in (backend, IdealBackend()))
    here, there = (velocities(states, robot.floating) for states in (got, expected))
    speed = np.abs(there).max(axis=(0, 2), keepdims=True)
    speed = np.maximum(speed, max(1e-6 * float(speed.max()), np.finfo(float).tiny))  # a control of 0 moves nothing
    slack = 0.0
    if robot.floating:
        fine = replace(scene, timestep=scene.timestep / 2)
        half = velocities(played(IdealBackend(), fine, controls, 2 * substeps, **start)[1:], True)
        slack += float(np.abs((there - half) / speed).max())
    if any(actuator.law == "thrust" for actuator in robot.actuators):
        slack += scene.timestep * max(float(np.abs(state.link_angular_velocity).max()) for state in expected)
    # Errors of the acceleration add up over the steps.
    noise = len(controls) * substeps * max(INERTIAL, rounding(backend, operations=1024))
    joints = slice(here.shape[2] - len(robot.joints), None)
    first, first_there = (array[:1, :, joints] / speed for array in (here, there))
    findings = [error(f"velocities {what}", here / speed, there / speed, noise + slack, "relative")]
    if substeps == 1:  # no base and no thrust has turned by then
        findings.append(error(f"joint velocities a timestep later {what}", first, first_there, noise, "relative"))
    efforts, wanted = (np.array([state.joint_effort for state in states]) for states in (got, expected))
    if size := float(np.abs(wanted).max(initial=0.0)):
        findings.append(error(f"efforts {what}", efforts / size, wanted / size, noise, "relative"))
    return findings


def actuator_response(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Compare the step response of every actuator of `robot` alone, from rest in weightlessness, with the reference.

    Each goes to both ends of its range, at the robot's own timestep; joint limits are left out.
    """
    robot = changed(robot, limits=None)
    ends = np.array([actuator.ctrl_range for actuator in robot.actuators])
    control = np.concatenate([np.diag(ends[:, side]) for side in (0, 1)])
    scene = robot_scene(robot, timestep=robot.timestep)
    what = "after a step of one control"
    return follows_reference(backend, scene, [control] * RESPONSE, 1, what, joint_position=inside(robot))


def thrust_climb(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Compare a flight under the robot's thrusts with the reference: at half and full control, under gravity.

    From home, and from just below the ceiling of the thrusts where they have one. Other drives
    are left out.
    """
    thrusts = tuple(actuator for actuator in robot.actuators if actuator.law == "thrust")
    robot = replace(robot, actuators=thrusts)
    full = np.array([thrust.ctrl_range[1] for thrust in thrusts])
    start: dict[str, Any] = {}
    ceiling = min(thrust.ceiling for thrust in thrusts)
    if robot.base != "planar" and np.isfinite(ceiling):
        start["base_position"] = [(0.0, 0.0, robot.home.height), (0.0, 0.0, ceiling - BELOW)]
    scene = robot_scene(robot, timestep=robot.timestep, gravity=EARTH)
    calls = max(2, _steps(robot) // robot.substeps)
    controls = [np.stack([full / 2, full])] * calls
    return follows_reference(backend, scene, controls, robot.substeps, "in flight under thrust", **start)


def joint_inertia(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Compare torque / acceleration of every joint that has armature with the model: inertia + armature.

    Each is driven alone, from rest in weightlessness, without damping and springs. The inertia is that of what hangs
    on the joint while the others are free, 1 / (M^-1)_jj - armature.
    """
    bare = changed(driven(robot), limits=None, damping=0.0, stiffness=0.0)
    rows = [i for i, joint in enumerate(robot.joints) if joint.armature]
    q = inside(robot)
    inertia = reflected_inertia(bare, q)[rows]
    control = np.zeros((len(rows), len(robot.joints)))
    control[np.arange(len(rows)), rows] = inertia  # for 1 rad/s^2 or 1 m/s^2
    scene = robot_scene(bare, timestep=robot.timestep)
    after = played(backend, scene, [control], 1, joint_position=q)[1]
    gained = after.joint_velocity[np.arange(len(rows)), rows] / robot.timestep
    noise = max(JOINT_INERTIA, rounding(backend, operations=1024))
    return [error("inertia + armature of single joints", 1.0 / gained, 1.0, noise, "relative")]


def reflected_inertia(robot: RobotModel, q: Array) -> Array:
    """Return 1 / (M^-1)_jj (J,) at joint positions `q` (J,): the inertia that each joint moves, the others free."""
    dynamics = Dynamics(robot)
    poses = dynamics.kinematics.poses(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), q[None])
    inverse = np.linalg.inv(dynamics.mass_matrix(poses)[0])
    return 1.0 / np.diag(inverse)[len(inverse) - len(q) :]


def energy_drift(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Let `robot` swing freely without damping, drives and limits, and look for what becomes of its energy.

    An integrator of the first order gains or loses O(h); the drift D(h) at two timesteps leaves 2 D(h/2) - D(h) at
    h -> 0, in which friction, damping and energy from nowhere would remain. What is left of the reference then is of
    the second order and sets the tolerance, beside a thousandth of the energy that moves.
    """
    bare = replace(changed(robot, damping=0.0, friction_loss=0.0, limits=None), actuators=())
    start = anywhere(robot, 2)
    drift = {}
    for engine in (backend, IdealBackend()):
        for part in (1, 2):
            h, steps = robot.timestep / part, part * _steps(robot)
            scene = robot_scene(bare, timestep=h, gravity=EARTH)
            with running(engine, scene, 2, **start) as world:
                before = world.state()
                world.step(idle(world), steps)
                after = world.state()
            drift[engine is backend, part] = energy(bare, after) - energy(bare, before)
    left, second = (2 * drift[own, 2] - drift[own, 1] for own in (True, False))
    dynamics = Dynamics(bare)
    poses = reference(bare, before)[0]
    speed = velocities([before], bare.floating)[0]
    moving = np.einsum("ni,nij,nj->n", speed, dynamics.mass_matrix(poses), speed) / 2
    scale = moving + np.abs(drift[False, 1])
    noise = 4 * rounding(backend, steps=2 * _steps(robot), operations=16)
    tolerance = 2 * float(np.abs(second / scale).max()) + SWING_LOSS + noise
    return [error("energy lost in a free swing, at a vanishing timestep", left / scale, 0.0, tolerance, "relative")]


def _steps(robot: RobotModel) -> int:
    """Return the timesteps of a swing of `robot`."""
    return max(1, min(TIMESTEPS, round(SWING / robot.timestep)))


def energy(robot: RobotModel, state: State) -> Array:
    """Return the kinetic energy, with that of the armatures, and the potential one of weight and springs: (N,) [J]."""
    poses = reference(robot, state)[0]
    speed = velocities([state], robot.floating)[0]
    kinetic = np.einsum("ni,nij,nj->n", speed, Dynamics(robot).mass_matrix(poses), speed) / 2
    mass = np.array([link.mass for link in robot.links])
    height = centres(robot, state)[..., 2]
    springs = [joint.stiffness for joint in robot.joints]
    stretch = state.joint_position - [joint.rest_position for joint in robot.joints]
    return kinetic + G * (mass * height).sum(axis=1) + (springs * stretch**2).sum(axis=1) / 2


def centres(robot: RobotModel, state: State) -> Array:
    """Return the centres of mass of the links (N, L, 3) in world axes, by the neutral kinematics."""
    poses = Kinematics(robot).poses(state.link_position[:, 0], state.link_quaternion[:, 0], state.joint_position)
    return poses.position + rotations.rotate(poses.quaternion, np.array([link.com for link in robot.links]))


def falls_freely(backend: Backend, robot: RobotModel) -> list[Finding]:
    """Drop a floating `robot` at rest: n (n + 1) g h^2 / 2 in n steps, and nothing in it moves."""
    bare = replace(changed(robot, stiffness=0.0), actuators=())
    steps = _steps(robot)
    start = {name: value for name, value in anywhere(robot, 4).items() if "velocity" not in name}
    scene = robot_scene(bare, timestep=robot.timestep, gravity=EARTH)
    before, after = played(backend, scene, [np.zeros((4, 0))], steps, **start)
    way = (after.link_position - before.link_position)[:, 0]
    fall = [0.0, 0.0, -steps * (steps + 1) * G * robot.timestep**2 / 2]
    noise = rounding(backend, 5.0, steps, operations=16)
    return worst([
        error("fall of the base", way, np.broadcast_to(fall, way.shape), noise, "m"),
        error("joints in free fall", after.joint_position, before.joint_position, noise, "rad, m"),
    ])  # fmt: skip
