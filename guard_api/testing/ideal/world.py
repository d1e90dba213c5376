"""Backend and world of `ideal`: exact multi-body dynamics without contacts, in NumPy alone.

It serves unit tests of everything above physics, is the reference for contact-free motion, and shows how small a
plugin is. Integration is semi-implicit Euler: velocities first, then positions with the new velocities.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields
from importlib.metadata import version
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from guard_api.conventions import BACKEND_API
from guard_api.errors import BackendError
from guard_api.model.dynamics import Dynamics, solve
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_api.physics.backend import CLOSED, Capabilities
from guard_api.physics.state import Inspection, Mask, Start, State, is_sound, state_shapes
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start
from guard_api.testing.ideal.bodies import FreeBodies, turned
from guard_api.testing.ideal.friction import rubbed
from guard_api.testing.ideal.stops import stopped

Array = NDArray[np.float64]
Data: TypeAlias = dict[str, NDArray[Any]]

_POSE = ("base_position", "base_quaternion", "joint_position")
_VELOCITY = ("base_linear_velocity", "base_angular_velocity", "joint_velocity")
_NO_ROBOT = RobotModel(name="none", base="fixed", root="none", links=(), joints=(), actuators=())


class IdealBackend:
    """Articulated robots and free bodies that nothing touches."""

    name = "ideal"
    api_version = BACKEND_API
    capabilities = Capabilities(contacts=False)

    def versions(self) -> dict[str, str]:
        """Return the version of NumPy, whose arithmetic decides the numbers."""
        return {"numpy": version("numpy")}

    def build(self, scene: SceneSpec, num_worlds: int, threads: int = 1) -> IdealWorld:
        """Build `num_worlds` copies of `scene`; `threads` has no effect."""
        return IdealWorld(scene, num_worlds)


class IdealWorld:
    """N worlds as one dictionary of arrays, replaced whole at each step and never written into."""

    def __init__(self, scene: SceneSpec, num_worlds: int) -> None:
        self.scene, self.num_worlds = scene, num_worlds
        robot = scene.robot
        self.approximations: tuple[str, ...] = ("nothing touches anything",)
        self._law = ActuationLaw(robot or _NO_ROBOT)
        self._robot = Dynamics(robot, scene.gravity) if robot else None
        self._bodies = FreeBodies(scene) if scene.num_bodies else None
        joints = (robot or _NO_ROBOT).joints
        self._loss = np.array([joint.friction_loss for joint in joints])
        limits = [joint.limits or (-np.inf, np.inf) for joint in joints]
        self._lower, self._upper = np.array(limits).reshape(-1, 2).T
        home = home_start(scene, num_worlds)
        self._arrays: Data | None = {item.name: getattr(home, item.name) for item in fields(Start)}
        self._data |= {"time": np.zeros(num_worlds), "ok": np.ones(num_worlds, bool)}
        self._data["joint_effort"] = np.zeros_like(home.joint_position)
        self._data |= {"target_position": home.body_position, "target_quaternion": home.body_quaternion}
        self._control = np.zeros((num_worlds, self._law.num_controls))

    def reset(self, mask: Mask, start: Start) -> None:
        """Start the worlds where `mask` (N,) is true from the rows of `start`."""
        fresh = {item.name: np.array(getattr(start, item.name), float) for item in fields(Start)}
        fresh |= {"time": np.zeros(self.num_worlds), "ok": np.ones(self.num_worlds, bool)}
        fresh["joint_effort"] = np.zeros_like(fresh["joint_position"])
        fresh |= {"target_position": fresh["body_position"], "target_quaternion": fresh["body_quaternion"]}
        self._data = _merge(mask, fresh, self._data)

    def step(self, control: NDArray[np.floating], substeps: int) -> None:
        """Advance by `substeps` under `control` (N, U); a world that fails keeps its state from before the step.

        A control that is not finite fails its world, although the law would clip an infinite one.
        """
        if np.shape(control) != self._control.shape:
            raise BackendError(f"control has shape {np.shape(control)}: give one row per world, {self._control.shape}")
        if substeps < 1:
            raise BackendError(f"substeps is {substeps}: step at least once")
        self._control = np.array(control, float)
        geared = self._law.geared(self._control)
        thrust = self._law.thrust(geared, self._thrust_heights())
        now = dict(self._data)
        with np.errstate(all="ignore"):  # a world that diverges is reported by `ok`
            for _ in range(substeps):
                if self._robot:
                    now |= self._move_robot(self._robot, now, geared, thrust)
                if self._bodies:
                    now |= self._bodies.fall(now)
            if self._bodies:
                now |= self._bodies.drive(now, self._data, substeps * self.scene.timestep)
        now["time"] = now["time"] + substeps * self.scene.timestep
        sound = [is_sound(array, array[:, :0]) if array.ndim > 1 else np.isfinite(array) for array in now.values()]
        sound += [is_sound(speeds, speeds) for speeds in self._speeds(now)]
        sound.append(np.logical_and.reduce(np.isfinite(self._control), axis=1))
        now["ok"] = self._data["ok"] & np.logical_and.reduce(sound)
        self._data = _merge(now["ok"], now, self._data) | {"ok": now["ok"]}

    def drive(self, group: str, position: Array, quaternion: Array) -> None:
        """Let the driven bodies of `group` reach (N, count, 3), (N, count, 4) by the end of the next `step`."""
        if group not in [item.name for item in self.scene.groups if item.body.physics == "driven"]:
            raise BackendError(f"{group!r} is no group of driven bodies")
        bodies = self.scene.body_slice(group)
        for name, target in (("target_position", position), ("target_quaternion", quaternion)):
            self._data[name] = self._data[name].copy()
            self._data[name][:, bodies] = target

    def state(self) -> State:
        """Return the present state."""
        data, shapes = self._data, state_shapes(self.scene, self.num_worlds)
        links = {name: np.zeros(shape) for name, shape in shapes.items() if name.startswith("link")}
        if self._robot:
            poses = self._robot.kinematics.poses(*(data[name] for name in _POSE))
            velocities = self._robot.kinematics.velocities(poses, *(data[name] for name in _VELOCITY))
            links["link_position"], links["link_quaternion"] = poses.position, poses.quaternion
            links["link_linear_velocity"], links["link_angular_velocity"] = velocities
        readings = {"touch": np.zeros(shapes["touch"]), "body_contact": np.zeros(shapes["body_contact"], bool)}
        own = {name: data[name].copy() for name in shapes if name in data}
        return State(**own, **links, **readings)

    def snapshot(self) -> bytes:
        """Return all arrays, headed by a digest of the scene and N."""
        return self._fingerprint() + b"".join(array.tobytes() for array in self._data.values())

    def restore(self, blob: bytes) -> None:
        """Return to a snapshot of an equal world. Raises BackendError for anything else."""
        head = self._fingerprint()
        if not blob.startswith(head) or len(blob) != len(self.snapshot()):
            raise BackendError(f"not a snapshot of {self.num_worlds} worlds of this scene on 'ideal'")
        at = len(head)
        for name, array in self._data.items():
            flat = np.frombuffer(blob, array.dtype, array.size, at)
            self._data[name] = flat.reshape(array.shape).copy()
            at += array.nbytes

    def inspect(self, world: int) -> Inspection:
        """Return the model's masses, and mass matrix and bias force at the world's present state."""
        links = (self.scene.robot or _NO_ROBOT).links
        matrix = bias = np.zeros((1, 0))
        if self._robot:
            row = {name: array[world : world + 1] for name, array in self._data.items()}
            poses = self._robot.kinematics.poses(*(row[name] for name in _POSE))
            matrix = self._robot.mass_matrix(poses)
            bias = self._robot.bias_force(poses, *(row[name] for name in _VELOCITY))
        return Inspection(
            link_mass=np.array([link.mass for link in links]),
            link_com=np.array([link.com for link in links]).reshape(-1, 3),
            link_inertia=np.array([link.inertia for link in links]).reshape(-1, 3, 3),
            mass_matrix=matrix[0] if self._robot else None,
            bias_force=bias[0] if self._robot else None,
            body_mass=np.array([b.mass if b.physics == "dynamic" else 0.0 for b in self.scene.bodies]),
        )

    def step_raw(self, substeps: int) -> None:
        """Advance under the last control."""
        self.step(self._control, substeps)

    def close(self) -> None:
        """Forget the worlds."""
        self._arrays = None

    @property
    def _data(self) -> Data:
        if self._arrays is None:
            raise BackendError(CLOSED)
        return self._arrays

    @_data.setter
    def _data(self, arrays: Data) -> None:
        self._arrays = arrays

    def _move_robot(self, robot: Dynamics, now: Data, geared: Array, thrust: Array) -> Data:
        q, qd, h = now["joint_position"], now["joint_velocity"], self.scene.timestep
        effort = self._law.joint_effort(geared, q, qd)
        torque = effort + self._law.spring_effort(q)
        poses = robot.kinematics.poses(*(now[name] for name in _POSE))
        velocities = [now[name] for name in _VELOCITY]
        base = robot.num_coordinates - q.shape[1]
        matrix, right = robot.equations(poses, *velocities, effort=torque, thrust=thrust, timestep=h)
        speed = np.concatenate([array.T for array in (velocities if base else velocities[2:])])
        if self._loss.any():
            a = rubbed(matrix, right, speed, np.concatenate([np.zeros(base), self._loss]), h)
        else:
            a = solve(matrix, right[:, None])[:, 0]
        u = stopped(matrix, speed + h * a, q.T, self._lower, self._upper, h).T
        qd = np.ascontiguousarray(u[:, base:])
        # Clipped, since a joint that ends its timestep at a stop may round to beyond it.
        moved: Data = {"joint_effort": effort, "joint_velocity": qd}
        moved["joint_position"] = np.clip(q + h * qd, self._lower, self._upper)
        if base:
            linear, angular = u[:, :3].copy(), u[:, 3:6].copy()
            moved |= {"base_linear_velocity": linear, "base_angular_velocity": angular}
            moved["base_position"] = now["base_position"] + h * linear
            moved["base_quaternion"] = turned(now["base_quaternion"], h * angular)
        return moved

    def _speeds(self, now: Data) -> list[Array]:
        """Return the velocities (N, ...) of everything that the physics moves."""
        if not self._bodies:
            return [now[name] for name in _VELOCITY]
        bodies = [np.where(self._bodies.dynamic, now[f"body_{kind}_velocity"], 0.0) for kind in ("linear", "angular")]
        return [now[name] for name in _VELOCITY] + bodies

    def _thrust_heights(self) -> Array | None:
        """Return the present heights (N, T) of the thrust links' origins if the law asks for them."""
        if not self._robot or not self._law.has_ceilings:
            return None
        poses = self._robot.kinematics.poses(*(self._data[name] for name in _POSE))
        return poses.position[:, self._law.thrust_link, 2]

    def _fingerprint(self) -> bytes:
        return hashlib.blake2b(repr((self.scene, self.num_worlds)).encode(), digest_size=16).digest()


def _merge(mask: Mask, chosen: Data, other: Data) -> Data:
    """Return the rows of `chosen` where `mask` (N,) is true, else those of `other`."""
    return {
        name: np.where(mask.reshape(-1, *[1] * (array.ndim - 1)), chosen[name], array) for name, array in other.items()
    }
