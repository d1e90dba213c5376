"""N copies of a scene, each in an engine instance of its own, advanced together one substep at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.model.kinematics import Kinematics
from guard_api.physics.backend import CLOSED
from guard_api.physics.state import Array, Inspection, Mask, Start, State
from guard_api.scene.spec import SceneSpec
from guard_bullet.bodies import Bodies
from guard_bullet.compile import Instance, approximations, build_instance, forget
from guard_bullet.contacts import ContactLog
from guard_bullet.drive import RobotDrive
from guard_bullet.engine import disconnect, pybullet
from guard_bullet.inspection import inspect_instance
from guard_bullet.snapshot import fingerprint, load, pack, unpack


class BulletWorld:
    """Implements `guard_api.physics.backend.World`; single-threaded, since the engine holds Python's lock."""

    def __init__(self, scene: SceneSpec, num_worlds: int) -> None:
        self.scene = scene
        self.num_worlds = num_worlds
        self.approximations = approximations(scene)
        self._engines: list[Instance] | None = []
        try:
            for _ in range(num_worlds):
                self._instances.append(build_instance(scene))
        except BaseException:
            self.close()
            raise
        self._drive = RobotDrive(scene, scene.robot, num_worlds) if scene.robot else None
        self._kinematics = Kinematics(scene.robot) if scene.robot else None
        self._bodies = Bodies(scene, num_worlds)
        self._contacts = ContactLog(scene, num_worlds)
        self._substeps = np.zeros(num_worlds, np.int64)
        self._ok = np.ones(num_worlds, bool)

    def reset(self, mask: Mask, start: Start) -> None:
        """Start the masked worlds from the rows of `start`, with no trace of what was before."""
        for world in np.flatnonzero(mask).tolist():
            self._renew(world, poisoned=not self._ok[world])
        self._bodies.start(mask, start)
        self._contacts.clear(mask)
        self._substeps[mask], self._ok[mask] = 0, True
        if self._drive:
            self._drive.clear(mask)
            self._drive.motion.start(mask, start)
        for world in np.flatnonzero(mask).tolist():
            self._bodies.write(world, self._instances[world])
            if self._drive:
                self._drive.write(world, self._instances[world])

    def step(self, control: NDArray[np.floating], substeps: int) -> None:
        """Advance all worlds that are ok by `substeps` timesteps under `control` (N, U)."""
        if self._drive:
            control = np.asarray(control, float)
            self._ok &= np.logical_and.reduce(np.isfinite(control), axis=1)
            self._drive.command(np.where(self._ok[:, None], control, 0.0))
        self._contacts.begin()
        self._bodies.depart(self._active(), self._instances, substeps * self.scene.timestep)
        for _ in range(substeps):
            self._substep()
            if self._contacts.needed:
                self._contacts.collect(self._active(), self._instances)
        self._contacts.finish()
        worlds = self._active()
        self._bodies.arrive(worlds, self._instances)
        self._bodies.read(worlds, self._instances)
        if self._drive:
            self._drive.motion.read_base(worlds, self._instances)
            self._ok &= self._drive.motion.sound
        self._ok &= self._bodies.sound

    def step_raw(self, substeps: int) -> None:
        """Advance by `substeps` under the last control, with the actuation law and nothing else."""
        for _ in range(substeps):
            self._substep()

    def drive(self, group: str, position: Array, quaternion: Array) -> None:
        """Let the driven bodies of `group` reach the poses by the end of the next step."""
        bodies = self.scene.body_slice(group)
        if any(body.physics != "driven" for body in self.scene.bodies[bodies]):
            raise BackendError(f"bullet: group {group!r} is not driven; only driven bodies can be given a target")
        self._bodies.aim(bodies, position, quaternion)

    def state(self) -> State:
        """Return the present state; the engine is not asked for anything, but must be there."""
        if self._engines is None:
            raise BackendError(CLOSED)
        bodies, drive = self._bodies, self._drive
        if drive and self._kinematics:
            motion = drive.motion
            poses = self._kinematics.poses(motion.base_position, motion.base_quaternion, motion.q)
            linear, angular = self._kinematics.velocities(poses, motion.base_linear, motion.base_angular, motion.qd)
            q, qd, effort = motion.q.copy(), motion.qd.copy(), drive.effort.copy()
            link_position, link_quaternion = poses.position, poses.quaternion
        else:
            q, qd, effort = np.zeros((3, self.num_worlds, 0))
            link_position, linear, angular = np.zeros((3, self.num_worlds, 0, 3))
            link_quaternion = np.zeros((self.num_worlds, 0, 4))
        return State(
            time=self._substeps.astype(float) * self.scene.timestep,
            joint_position=q,
            joint_velocity=qd,
            joint_effort=effort,
            link_position=link_position,
            link_quaternion=link_quaternion,
            link_linear_velocity=linear,
            link_angular_velocity=angular,
            body_position=bodies.position.copy(),
            body_quaternion=bodies.quaternion.copy(),
            body_linear_velocity=bodies.linear.copy(),
            body_angular_velocity=bodies.angular.copy(),
            body_contact=self._contacts.body_contact.copy(),
            touch=self._contacts.touch.copy(),
            ok=self._ok.copy(),
        )

    def snapshot(self) -> bytes:
        """Return all worlds' states as bytes."""
        return pack(fingerprint(self.scene, self.num_worlds), self._instances, self._arrays())

    def restore(self, blob: bytes) -> None:
        """Return to a snapshot of an equal world. Raises BackendError for any other bytes."""
        poisoned = ~self._ok
        states = unpack(blob, fingerprint(self.scene, self.num_worlds), self._arrays())
        for world, state in enumerate(states):
            self._renew(world, poisoned=bool(poisoned[world]))
            load(self._instances[world], state)

    def inspect(self, world: int) -> Inspection:
        """Return what the engine holds for one world."""
        motion = self._drive.motion if self._drive else None
        return inspect_instance(self._instances[world], world, self.scene, motion)

    def close(self) -> None:
        """Free all engine instances."""
        for instance in self._engines or ():
            disconnect(instance.client)
        self._engines = None

    @property
    def _instances(self) -> list[Instance]:
        if self._engines is None:
            raise BackendError(CLOSED)
        return self._engines

    def _active(self) -> list[int]:
        return np.flatnonzero(self._ok).tolist()

    def _substep(self) -> None:
        """Evaluate the law, advance the engine one timestep and fetch what the law needs next."""
        worlds = self._active()
        self._bodies.damp(worlds, self._instances)
        if self._drive:
            self._ok &= self._drive.advance(worlds, self._instances)
        else:
            for world in worlds:
                pybullet.stepSimulation(self._instances[world].client)
        self._substeps[worlds] += 1

    def _renew(self, world: int, *, poisoned: bool) -> None:
        """Empty a world's engine instance of its history; one that may hold NaN is replaced."""
        if poisoned:
            fresh = build_instance(self.scene)
            disconnect(self._instances[world].client)
            self._instances[world] = fresh
        forget(self._instances[world])

    def _arrays(self) -> dict[str, NDArray]:
        """Return everything that a snapshot keeps beside the engine's own states, by name."""
        arrays: dict[str, NDArray] = {"substeps": self._substeps, "ok": self._ok}
        arrays |= {
            f"body_{name}": getattr(self._bodies, name) for name in ("position", "quaternion", "linear", "angular")
        }
        arrays |= self._contacts.arrays()
        if self._drive:
            arrays |= self._drive.arrays()
        return arrays
