"""Thrusts that lose their offset above a ceiling: MuJoCo's actuators know no height."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from guard_api.model.kinematics import Rows
from guard_api.physics.actuation import ActuationLaw
from guard_mujoco.compile import CompiledScene

Array = NDArray[np.float64]


class Ceilings:
    """Turns the controls of thrusters with a ceiling into forces [N], once per step; the others pass unchanged.

    any: whether there are such thrusters.
    """

    def __init__(self, compiled: CompiledScene, batch: Batch) -> None:
        robot = compiled.scene.robot
        self._law = ActuationLaw(robot) if robot else None
        self.any = self._law is not None and self._law.has_ceilings
        thrusters = [(k, i) for k, i in enumerate(self._law.on_link)] if robot and self._law else []
        under = [(k, i) for k, i in thrusters if robot and np.isfinite(robot.actuators[i].ceiling)]
        self._of_law, self._columns = [k for k, _ in under], [i for _, i in under]
        self._bodies = compiled.link_body[self._law.thrust_link] if self._law else np.empty(0, np.intp)
        self._xpos = batch.bind("xpos")

    def commands(self, control: Array, rows: Rows) -> Array:
        """Return `control` (n, U) of the worlds `rows`, whose positions are current, as MuJoCo's actuators take it."""
        assert self._law is not None
        height = self._xpos[rows][:, self._bodies, 2]
        force = self._law.thrust_size(self._law.geared(control), height)
        commands = np.array(control, float)
        commands[:, self._columns] = force[:, self._of_law]
        return commands
