"""What is asked after every step: the efforts on the joints, and whether anything went wrong in any world."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api.conventions import DIVERGED_SPEED
from guard_api.physics.state import Array, Mask
from guard_mujoco import kernels
from guard_mujoco.compile import CompiledScene

_LIMIT = DIVERGED_SPEED**2


class Aftermath:
    """Reads a batch just stepped. A joint's effort is the sum of its actuators' forces in the last substep."""

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        robot = compiled.scene.robot
        servos = [(i, str(a.joint)) for i, a in enumerate(robot.actuators) if a.law != "thrust"] if robot else []
        joints = [robot.joint_index(joint) for _, joint in servos] if robot else []
        self._servos = np.array([[i for i, _ in servos], joints], np.intp)
        # The engine has limited what one actuator alone gives its joint.
        shared = [joints.count(joint) > 1 for joint in range(len(compiled.joint_dof))]
        limits = [joint.effort_limit for joint in robot.joints] if robot else []
        self._limit = np.where(shared, limits, np.inf)
        self._qvel, self._warning = batch.bind("qvel"), batch.warning
        self._force = batch.bind("actuator_force") if servos else np.empty((batch.nsim, 0))
        self._verdict = np.zeros(1, bool)

    def read(self, effort: Array, ok: Mask) -> bool:
        """Write the joints' efforts (N, J) [N m or N] of the worlds that are `ok` (N,); return whether all is well.

        It is when all worlds are `ok`, without warnings and not too fast. Without a warning accelerations were finite,
        so the numbers are when the velocities are; no sum of squares with NaN is small. False may be a false alarm.
        """
        read = kernels.aftermath() or _read
        read(self._qvel, self._warning, self._force, self._servos, self._limit, ok, _LIMIT, effort, self._verdict)
        return bool(self._verdict[0])


def _read(
    qvel: Array,
    warning: NDArray[np.int32],
    force: Array,
    servos: NDArray[np.intp],
    limit: Array,
    ok: Mask,
    speed_limit: float,
    effort: Array,
    verdict: NDArray[np.bool_],
) -> None:
    """Write the `effort` (N, J) and the `verdict` (1,); servos (2, K): actuators and their joints, limit (J,)."""
    summed = np.zeros_like(effort)
    for actuator, joint in servos.T:
        summed[:, joint] += force[:, actuator]
    np.copyto(effort, np.clip(summed, -limit, limit), where=ok[:, None])
    verdict[0] = np.vdot(qvel, qvel) <= speed_limit and ok.all() and not np.count_nonzero(warning)
