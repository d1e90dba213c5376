"""N worlds of one scene, stepped together by MuJoCo's batch."""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.model.kinematics import Rows
from guard_api.physics.backend import CLOSED
from guard_api.physics.state import Array, Inspection, Mask, Start, State, is_sound
from guard_mujoco.aftermath import Aftermath
from guard_mujoco.ceilings import Ceilings
from guard_mujoco.compile import CompiledScene
from guard_mujoco.diagnostics import redirect_warnings
from guard_mujoco.driven import DrivenBodies
from guard_mujoco.inspection import inspect
from guard_mujoco.placement import check_start, place
from guard_mujoco.readout import Readout
from guard_mujoco.snapshot import fingerprint, pack, unpack

_NONE, _VEL = mujoco.mjtStage.mjSTAGE_NONE.value, mujoco.mjtStage.mjSTAGE_VEL.value
_COUNT = 1
"""Column of a warning counter that counts; the other one is its last information."""

ALL = slice(None)


class MuJoCoWorld:
    """A `guard_api.physics.backend.World`.

    The engine keeps one MjData per world, so that the positions and velocities computed for `state` are the first half
    of the next step and cost nothing extra. A world that fails returns to its last finite state and stays there.
    """

    def __init__(self, compiled: CompiledScene, num_worlds: int, threads: int) -> None:
        redirect_warnings()
        self.scene = compiled.scene
        self.num_worlds = num_worlds
        self.approximations = compiled.approximations
        self._compiled = compiled
        self._engine: Batch | None = Batch(compiled.model, num_worlds, threads, persistent=True)
        self._ctrl, self._time, self._qvel = (self._batch.bind(name) for name in ("ctrl", "time", "qvel"))
        self._readout = Readout(compiled, self._batch)
        self._aftermath = Aftermath(compiled, self._batch)
        self._ceilings = Ceilings(compiled, self._batch)
        self._driven = DrivenBodies(compiled, self._batch)
        self._ok = np.ones(num_worlds, bool)
        self._everyone = np.arange(num_worlds)
        self._effort = np.zeros((num_worlds, len(compiled.joint_dof)))
        self._touch = np.zeros((num_worlds, compiled.contact.num_touch))
        self._body_contact = np.zeros((num_worlds, self.scene.num_bodies), bool)
        self._history = self._batch.bind("history")
        self._before = np.empty_like(self._batch.state)
        self._identity = fingerprint(compiled.model, num_worlds)
        self._current = False  # whether the engine's positions and velocities are those of the state rows

    def reset(self, mask: Mask, start: Start) -> None:
        """Start the masked worlds from the rows of `start`; see `World.reset`.

        Worlds whose start is not finite are not `ok` and stand at the model's own initial state.
        Raises BackendError for a start in motion of what cannot move by itself.
        """
        rows = np.flatnonzero(mask)
        if not len(rows):
            return
        check_start(self._compiled, start, rows)
        self._batch.reset(rows, stage=_NONE)
        place(self._compiled, self._batch, start, rows)
        self._ok[rows] = np.isfinite(self._batch.state[rows]).all(axis=1)
        self._batch.reset(rows[~self._ok[rows]], stage=_NONE)
        self._driven.hold(rows)
        for summary in (self._effort, self._touch, self._body_contact):
            summary[rows] = 0
        self._batch.forward(rows, stage=_VEL)

    def step(self, control: NDArray[np.floating], substeps: int) -> None:
        """Advance all worlds by `substeps` timesteps under `control` (N, U); see `World.step`.

        Raises BackendError for fewer than one substep.
        """
        if substeps < 1:
            raise BackendError(f"substeps={substeps}: must be at least 1")
        # The sum of squares is finite where all are, but for numbers so large that these are looked at one by one.
        if not math.isfinite(np.vdot(control, control)):
            self._ok &= np.isfinite(control).all(axis=1)
        rows = ALL if np.count_nonzero(self._ok) == self.num_worlds else np.flatnonzero(self._ok)
        np.copyto(self._before, self._batch.state)
        self._ctrl[rows] = self._commands(control, rows)
        if self._driven.any:
            self._driven.launch(self._everyone[rows], substeps * self.scene.timestep)
        self._advance(rows, substeps)
        self._current |= rows is ALL
        self._freeze_failed(rows)

    def drive(self, group: str, position: Array, quaternion: Array) -> None:
        """Let the driven bodies of `group` reach the poses by the end of the next `step`; see `World.drive`."""
        self._driven.aim(group, position, quaternion)

    def state(self) -> State:
        """Return the present state; see `World.state`."""
        self._update()
        joints, links, bodies = self._readout.read()
        return State(
            time=self._time.copy(),
            joint_position=joints[0],
            joint_velocity=joints[1],
            joint_effort=self._effort.copy(),
            link_position=links.position,
            link_quaternion=links.quaternion,
            link_linear_velocity=links.linear,
            link_angular_velocity=links.angular,
            body_position=bodies.position,
            body_quaternion=bodies.quaternion,
            body_linear_velocity=bodies.linear,
            body_angular_velocity=bodies.angular,
            body_contact=_own(self._body_contact),
            touch=_own(self._touch),
            ok=self._ok.copy(),
        )

    def snapshot(self) -> bytes:
        """Return all worlds' states, the solver's warm start included, as bytes for `restore`."""
        return pack(self._identity, self._everything())

    def restore(self, blob: bytes) -> None:
        """Return to a snapshot. Raises BackendError when it is not one of an equal world."""
        unpack(blob, self._identity, self._everything())
        self._batch.warning[...] = 0
        self._current = False

    def inspect(self, world: int) -> Inspection:
        """Return what the engine holds for one world; see `World.inspect`."""
        return inspect(self._compiled, self._batch.get_model(world), self._batch.get_data(world))

    def step_raw(self, substeps: int) -> None:
        """Step the bare engine under the last control, reading nothing back; see `World.step_raw`."""
        self._batch.step(nstep=substeps)
        self._current = False

    def close(self) -> None:
        """Release the engine; calling it twice is allowed."""
        self._engine = None

    @property
    def _batch(self) -> Batch:
        if self._engine is None:
            raise BackendError(CLOSED)
        return self._engine

    def _update(self) -> None:
        """Make the engine's positions and velocities those of the state rows."""
        if not self._current:
            self._batch.forward(stage=_VEL)
            self._current = True

    def _commands(self, control: NDArray[np.floating], rows: Rows) -> NDArray[np.floating]:
        """Return the worlds `rows` of `control` as MuJoCo's actuators take them."""
        if not self._ceilings.any:
            return control[rows]
        self._update()
        return self._ceilings.commands(np.asarray(control[rows], float), rows)

    def _advance(self, rows: Rows, substeps: int) -> None:
        """Step the worlds `rows`, bring positions and velocities up to date and sum up what their sensors felt."""
        ids, contact = None if isinstance(rows, slice) else rows, self._compiled.contact
        if not contact.any:
            self._attempt(lambda: self._batch.step(ids, nstep=substeps, stage=_VEL))
            return
        self._touch[rows], self._body_contact[rows] = 0.0, False
        for portion in contact.portions(substeps):
            self._attempt(lambda n=portion: self._batch.step(ids, nstep=n, stage=_VEL))
            touch, touched = contact.read(self._history[rows], portion)
            self._touch[rows] += touch
            self._body_contact[rows] |= touched
        self._touch[rows] /= substeps

    def _attempt(self, call: Callable[[], object]) -> None:
        """Run one call of the engine; the worlds in which it raises an error are no longer `ok`."""
        try:
            call()
        except SimulationError as error:
            self._ok[error.ids] = False

    def _freeze_failed(self, rows: Rows) -> None:
        """Take over the efforts, and put worlds whose numbers went wrong back to before the step."""
        if self._aftermath.read(self._effort, self._ok):
            return
        batch, failed = self._batch, self._newly_failed(rows)
        if len(failed):
            self._ok[failed] = False
            batch.state[failed] = self._before[failed]
            batch.forward(failed, stage=_VEL)
            for summary in (self._effort, self._touch, self._body_contact):
                summary[failed] = 0

    def _newly_failed(self, rows: Rows) -> NDArray[np.intp]:
        """Return which of the worlds just stepped raised an error or a warning, or hold numbers that are not sound."""
        batch = self._batch
        stepped = np.zeros(self.num_worlds, bool)
        stepped[rows] = True
        # Each of the engine's warnings means that it left out or invented something.
        warned = batch.warning[:, :, _COUNT].any(axis=1)
        sound = self._ok & ~warned & is_sound(batch.state, self._qvel[:, self._compiled.own_dofs])
        return np.flatnonzero(stepped & ~sound)

    def _everything(self) -> list[NDArray]:
        """Return the arrays that are the worlds' state; writing into them changes it."""
        summaries = (self._effort, self._touch, self._body_contact)
        return [self._batch.state, self._ok, self._driven.target, *summaries]


def _own(summary: NDArray) -> NDArray:
    """Return a copy, or the array itself where it holds nothing that anybody could change."""
    return summary.copy() if summary.size else summary
