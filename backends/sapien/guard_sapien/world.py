"""N worlds on PhysX's CPU solver, behind GUARD's contract."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.model.kinematics import Kinematics
from guard_api.physics.backend import CLOSED
from guard_api.physics.state import Array, Inspection, Mask, Start, State, is_sound
from guard_api.scene.spec import SceneSpec
from guard_sapien import contacts
from guard_sapien.compile import check, cylinder_notes
from guard_sapien.contacts import ContactLog
from guard_sapien.control import RobotControl
from guard_sapien.driving import Drives, send
from guard_sapien.fleet import Fleet
from guard_sapien.inspection import inspect_copy
from guard_sapien.placing import finite_rows, place, place_static
from guard_sapien.record import Record, fingerprint, from_bytes, to_bytes
from guard_sapien.surfaces import ContactTable


class SapienWorld:
    """`guard_api.physics.backend.World` on PhysX's CPU solver; see there for every method."""

    def __init__(self, scene: SceneSpec, num_worlds: int) -> None:
        check(scene)
        if num_worlds < 1:
            raise BackendError(f"num_worlds {num_worlds} must be at least 1")
        self.scene, self.num_worlds = scene, num_worlds
        table = ContactTable(scene)
        self.approximations = (*table.approximations, *cylinder_notes(scene))
        self._engine: Fleet | None = Fleet(scene, num_worlds, table)
        self._control = RobotControl(scene.robot, self._fleet.copies[0]) if scene.robot else None
        self._kinematics = Kinematics(scene.robot) if scene.robot else None
        self._record = Record(scene, num_worlds)
        self._contacts = None
        if contacts.wanted(scene):
            self._contacts = ContactLog(scene, self._fleet.copies, self._record.impulse, self._record.touched)
        self._drives = Drives(scene, num_worlds)

    def reset(self, mask: Mask, start: Start) -> None:
        """Start the worlds of `mask` anew; one whose numbers had become non-finite is built anew first."""
        worlds = np.flatnonzero(mask)
        finite = finite_rows(start)
        self._renew(worlds)
        order = self._control.of_engine if self._control else np.zeros(0, np.intp)
        for world in worlds.tolist():
            if finite[world]:
                place(self._fleet.copies[world], self.scene, order, start, world)
                self._drives.place(world, start.body_position[world], start.body_quaternion[world])
        self._record.ok[worlds] = finite[worlds]
        self._record.clear(worlds)
        self._fleet.changed(worlds)
        self._fleet.retire(worlds[~finite[worlds]])

    def step(self, control: NDArray[np.floating], substeps: int) -> None:
        """Advance every `ok` world; one with a non-finite control or state stops being `ok` and is left alone."""
        control = np.asarray(control, float)
        record = self._record
        if control.shape != record.control.shape or substeps < 1:
            raise BackendError(f"step(control {control.shape}, {substeps}): control must be {record.control.shape}")
        self._stop(np.logical_or.reduce(~np.isfinite(control), axis=1))
        worlds = np.flatnonzero(record.ok)
        record.control[worlds] = control[worlds]
        record.impulse[worlds], record.touched[worlds] = 0.0, False
        record.last_substeps[worlds] = substeps
        self._advance(worlds.tolist(), substeps, read_contacts=True)
        packed = self._fleet.read()
        self._stop(~is_sound(packed, self._fleet.layout.speeds(packed)))

    def step_raw(self, substeps: int) -> None:
        """Run law and engine under the last control, reading nothing that the law does not need."""
        self._advance(np.flatnonzero(self._record.ok).tolist(), substeps, read_contacts=False)

    def drive(self, group: str, position: Array, quaternion: Array) -> None:
        """Send a driven group to its poses; the next `step` takes it there."""
        bodies = self.scene.body_slice(group)
        if any(body.physics != "driven" for body in self.scene.bodies[bodies]):
            raise BackendError(f"group {group!r} is not driven: only driven bodies can be moved")
        self._drives.aim(bodies, position, quaternion)

    def state(self) -> State:
        """Return the present state, read from PhysX; link states by `Kinematics` from the joint state."""
        packed = self._fleet.read()
        q, qd, links = self._robot_state(packed)
        position, quaternion, linear, angular = self._body_state(packed)
        record = self._record
        return State(
            time=record.time(self.scene.timestep),
            joint_position=q, joint_velocity=qd, joint_effort=record.effort.copy(),
            link_position=links[0], link_quaternion=links[1],
            link_linear_velocity=links[2], link_angular_velocity=links[3],
            body_position=position, body_quaternion=quaternion,
            body_linear_velocity=linear, body_angular_velocity=angular,
            body_contact=record.touched.copy(), touch=record.mean_touch(self.scene.timestep), ok=record.ok.copy(),
        )  # fmt: skip

    def snapshot(self) -> bytes:
        """Return everything that decides the future, except what PhysX keeps to itself (see the README)."""
        packed = self._fleet.read().astype(np.float32)
        return to_bytes(fingerprint(self.scene, self.num_worlds), [*self._saved(), packed])

    def restore(self, blob: bytes) -> None:
        """Return to a snapshot of an equal world."""
        packed = np.empty((self.num_worlds, self._fleet.layout.width), np.float32)
        mark = fingerprint(self.scene, self.num_worlds)
        from_bytes(mark, blob, [*self._saved(), packed])
        self._renew(np.arange(self.num_worlds))
        for copy, position, quaternion in zip(
            self._fleet.copies, self._drives.position, self._drives.quaternion, strict=True
        ):
            place_static(copy, self.scene, position, quaternion)
        self._fleet.write(packed, self._record.ok)

    def inspect(self, world: int) -> Inspection:
        """Return masses, inertias, mass matrix and bias force as PhysX holds them."""
        return inspect_copy(self.scene, self._fleet.copies[world], self._control.of_model if self._control else None)

    def close(self) -> None:
        """Release the scenes."""
        self._engine = self._contacts = None

    @property
    def _fleet(self) -> Fleet:
        if self._engine is None:
            raise BackendError(CLOSED)
        return self._engine

    def _saved(self) -> list[np.ndarray]:
        return [*self._record.arrays(), *self._drives.arrays()]

    def _renew(self, worlds: NDArray[np.intp]) -> None:
        for world in self._fleet.renew(worlds):
            if self._contacts:
                self._contacts.renew(world, self._fleet.copies[world])

    def _stop(self, failed: Mask) -> None:
        """Let the worlds that `failed` (N,) be not ok from now on."""
        newly = np.flatnonzero(failed & self._record.ok)
        if len(newly):
            self._record.ok[newly] = False
            self._fleet.retire(newly)

    def _advance(self, worlds: list[int], substeps: int, read_contacts: bool) -> None:
        """Run `substeps` of law and engine in `worlds`."""
        record, copies = self._record, [self._fleet.copies[world] for world in worlds]
        log = self._contacts if read_contacts else None
        set_forces = self._control.run(copies, record.control[worlds]) if self._control else None
        way = self._drives.waypoints(worlds, substeps)
        steps = [system.step for system, _ in self._fleet.layout.systems(copies)]
        effort = record.effort[worlds]
        # A world that blows up overflows on its way to not being ok; that is no reason to warn.
        with np.errstate(over="ignore", invalid="ignore"):
            for substep in range(substeps):
                if set_forces:
                    effort = set_forces()
                send(self._fleet.copies, way, substep)
                if log:
                    log.prepare(worlds)
                for step in steps:
                    step()
                if log:
                    for world in worlds:
                        log.collect(world)
        if log:
            log.finish()
        record.effort[worlds] = effort
        record.substeps[worlds] += substeps
        self._drives.arrive(worlds)
        self._fleet.changed(worlds)

    def _robot_state(self, packed: Array) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
        """Return q, qd (N, J) and the links' position, quaternion, linear and angular velocity (N, L, ...)."""
        if self._control is None or self._kinematics is None or self.scene.robot is None:
            none, points = np.zeros((self.num_worlds, 0)), np.zeros((self.num_worlds, 0, 3))
            return none, none, (points, np.zeros((self.num_worlds, 0, 4)), points, points)
        q, qd = (half.take(self._control.of_model, axis=1) for half in self._fleet.layout.joints(packed))
        root = self._fleet.layout.root(packed)
        quaternion, position = unit(root[:, :4]), root[:, 4:7]
        angular = root[:, 10:13]
        # PhysX's velocity is that of the com.
        arm = rotations.rotate(quaternion, np.asarray(self.scene.robot.links[0].com))
        linear = root[:, 7:10] - rotations.cross(angular, arm)
        with np.errstate(invalid="ignore"):  # worlds that are not ok may hold NaN
            poses = self._kinematics.poses(position, quaternion, q)
            velocities = self._kinematics.velocities(poses, linear, angular, qd)
        return q, qd, (poses.position, poses.quaternion, *velocities)

    def _body_state(self, packed: Array) -> tuple[Array, Array, Array, Array]:
        """Return position, quaternion, linear and angular velocity of the bodies: (N, B, ...)."""
        position, quaternion = self._drives.position.copy(), self._drives.quaternion.copy()
        linear, angular = np.zeros_like(position), np.zeros_like(position)
        rows, moving = self._fleet.layout.bodies(packed), self._fleet.layout.moving
        if moving:
            quaternion[:, moving], position[:, moving] = unit(rows[..., :4]), rows[..., 4:7]
            linear[:, moving], angular[:, moving] = rows[..., 7:10], rows[..., 10:13]
        return position, quaternion, linear, angular


def unit(quaternion: Array) -> Array:
    """Return float32 quaternions (..., 4) normalised in float64."""
    return quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
