"""What a world says of itself, and what it is started from: batched arrays in the conventions of GUARD."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from guard_api.conventions import DIVERGED_SPEED
from guard_api.scene.spec import SceneSpec

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """The state of N worlds after a reset or step. N worlds, J joints, L links, B bodies, K touch sensors.

    The arrays belong to the caller: no later call to the world changes them.

    time: (N,) [s] since each world's reset.
    joint_position, joint_velocity: (N, J) [rad, rad/s] or [m, m/s].
    joint_effort: (N, J) actuator effort on the joint in the last substep [N m] or [N]; 0 after a reset.
    link_position (N, L, 3) [m], link_quaternion (N, L, 4), link_linear_velocity (N, L, 3) [m/s] of the link-frame
    origin, link_angular_velocity (N, L, 3) [rad/s]; all in world axes.
    body_position (N, B, 3), body_quaternion (N, B, 4), body_linear_velocity, body_angular_velocity (N, B, 3): likewise;
    a body's frame is at its centre of mass.
    body_contact: (N, B) whether the robot touched the body in any substep of the last step; False after a reset.
    touch: (N, K) [N] normal contact force on each of `RobotModel.touch_sensors` from everything that is not the robot,
    averaged over the substeps of the last step (see `guard_api.physics.touch`); 0 after a reset.
    ok: (N,) False once a world's numbers became non-finite, the speed of a joint, a floating base or a dynamic body
    exceeded `guard_api.conventions.DIVERGED_SPEED`, or its engine gave up; stays False until reset. Looked at after
    every step.
    """

    time: Array
    joint_position: Array
    joint_velocity: Array
    joint_effort: Array
    link_position: Array
    link_quaternion: Array
    link_linear_velocity: Array
    link_angular_velocity: Array
    body_position: Array
    body_quaternion: Array
    body_linear_velocity: Array
    body_angular_velocity: Array
    body_contact: Mask
    touch: Array
    ok: Mask


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Where worlds begin: full arrays over all N worlds, of which `World.reset` uses the masked rows.

    base_*: pose and velocity of the first link, (N, 3), (N, 4), (N, 3), (N, 3); for a fixed base the velocities must be
    zero; for a planar base the pose must be the identity, since its joints hold it (see `guard_api.scene.start`).
    joint_position, joint_velocity: (N, J).
    body_*: as in `State`; the velocities of static and driven bodies must be zero.
    """

    base_position: Array
    base_quaternion: Array
    base_linear_velocity: Array
    base_angular_velocity: Array
    joint_position: Array
    joint_velocity: Array
    body_position: Array
    body_quaternion: Array
    body_linear_velocity: Array
    body_angular_velocity: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """What an engine says it simulates for one world: compared with the model by the conformance suite.

    link_mass (L,), link_com (L, 3), link_inertia (L, 3, 3) about the com: in link axes; virtual links read what the
    engine holds. mass_matrix (D, D), armature included and bias_force (D,) (Coriolis and gravity, with the sign
    M a + bias = effort) at the world's current state; D = J, or 6 + J for a floating base ordered base linear, base
    angular (world axes, at the link-frame origin), joints. None where the engine cannot say: a declared gap.
    body_mass (B,) of the dynamic bodies, 0 for the others.
    """

    link_mass: Array
    link_com: Array
    link_inertia: Array
    mass_matrix: Array | None
    bias_force: Array | None
    body_mass: Array


def state_shapes(scene: SceneSpec, num_worlds: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of every array of `State` for N worlds of `scene`, by field name."""
    robot = scene.robot
    num_joints = len(robot.joints) if robot else 0
    num_links = len(robot.links) if robot else 0
    num_touch = len(robot.touch_sensors) if robot else 0
    axes = {
        "time": (), "ok": (),
        "joint_position": (num_joints,), "joint_velocity": (num_joints,), "joint_effort": (num_joints,),
        "link_position": (num_links, 3), "link_quaternion": (num_links, 4),
        "link_linear_velocity": (num_links, 3), "link_angular_velocity": (num_links, 3),
        "body_position": (scene.num_bodies, 3), "body_quaternion": (scene.num_bodies, 4),
        "body_linear_velocity": (scene.num_bodies, 3), "body_angular_velocity": (scene.num_bodies, 3),
        "body_contact": (scene.num_bodies,), "touch": (num_touch,),
    }  # fmt: skip
    return {item.name: (num_worlds, *axes[item.name]) for item in fields(State)}


def is_sound(values: Array, speeds: Array) -> Mask:
    """Return (N,) whether a world's `values` (N, ...) are finite and its `speeds` (N, ...) those of physics.

    See `guard_api.conventions.DIVERGED_SPEED`; NaN is no speed.
    """
    finite = np.isfinite(values).reshape(len(values), -1)
    slow = (np.abs(speeds) <= DIVERGED_SPEED).reshape(len(speeds), -1)
    return np.logical_and.reduce(finite, axis=1) & np.logical_and.reduce(slow, axis=1)


def state_dtype(name: str) -> type:
    """Return the dtype of the `State` array called `name`."""
    return np.bool_ if name in {"ok", "body_contact"} else np.float64
