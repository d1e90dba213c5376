"""The one actuation law: from controls to joint efforts and thrusts, the same on every backend.

Evaluated at every substep from the joint state at its beginning:

    u      = clip(control, ctrl_range)
    effort = clip(gear u, +-effort_limit)                                        law "effort"
           = clip(kp (gear u + offset - q) - kd qd, +-effort_limit)              law "position"
           = clip(kd (gear u + offset - qd), +-effort_limit)                     law "velocity"
    force  = clip(gear u + offset, +-effort_limit) along `direction` at `point`  law "thrust"

The actuator efforts on one joint are added and clipped to the joint's own effort limit. Thrusts alone are constant over
the substeps of a step: `offset` is 0 throughout a step at whose beginning the link's origin is above `ceiling`.

The passive part is no actuator's effort and no limit clips it. With D the joint dampings, K the stiffnesses, A the
armatures, h the timestep,

    (M + A + h D) qdd = effort - D qd - K (q - rest) - bias

which is MuJoCo's semi-implicit Euler rule: damping implicit, springs explicit. An engine without it gets the same
numbers by an extra armature h D and an explicit torque -D qd - K (q - rest). An undamped spring is stable while
h sqrt(K / inertia) < 2. Dry friction is the engine's own Coulomb constraint.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from guard_api.model.robot import Actuator, RobotModel

Array = NDArray[np.float64]


class ActuationLaw:
    """The law of one robot, compiled to arrays. Pure: it holds no state between calls."""

    def __init__(self, robot: RobotModel) -> None:
        self.actuators = robot.actuators
        self.on_joint = [i for i, a in enumerate(robot.actuators) if a.law != "thrust"]
        self.on_link = [i for i, a in enumerate(robot.actuators) if a.law == "thrust"]
        servos = [robot.actuators[i] for i in self.on_joint]
        self.joint = np.array([robot.joint_index(str(a.joint)) for a in servos], dtype=np.intp)
        self.thrust_link = np.array([robot.link_index(str(robot.actuators[i].link)) for i in self.on_link], np.intp)
        self.thrust_point = _column([robot.actuators[i].point for i in self.on_link], (0, 3))
        self.thrust_direction = _column([robot.actuators[i].direction for i in self.on_link], (0, 3))
        self.lower = np.array([a.ctrl_range[0] for a in self.actuators])
        self.upper = np.array([a.ctrl_range[1] for a in self.actuators])
        self.gear = np.array([a.gear for a in self.actuators])
        self.limit = np.array([a.effort_limit for a in self.actuators])
        # effort = scale * target - kp q - kd qd covers the three joint laws with one expression
        self._scale = np.array([_target_gain(a) for a in servos])
        self._offset = np.array([_target_gain(a) * a.offset if a.law != "effort" else 0.0 for a in servos])
        self._kp = np.array([a.kp if a.law == "position" else 0.0 for a in servos])
        self._kd = np.array([a.kd if a.law in {"position", "velocity"} else 0.0 for a in servos])
        self.joint_limit = np.array([joint.effort_limit for joint in robot.joints])
        self._stiffness = np.array([joint.stiffness for joint in robot.joints])
        self._rest = np.array([joint.rest_position for joint in robot.joints])
        self._hover = np.array([robot.actuators[i].offset for i in self.on_link])
        self._ceiling = np.array([robot.actuators[i].ceiling for i in self.on_link])
        self._incidence = np.zeros((len(servos), len(robot.joints)))
        self._incidence[np.arange(len(servos)), self.joint] = 1.0

    @property
    def num_controls(self) -> int:
        """Number of controls U."""
        return len(self.actuators)

    @property
    def has_springs(self) -> bool:
        """Whether `spring_effort` can be anything but zero."""
        return bool(self._stiffness.any())

    @property
    def has_ceilings(self) -> bool:
        """Whether thrusts must be told heights."""
        return bool(np.isfinite(self._ceiling).any())

    def geared(self, control: NDArray[np.floating]) -> Array:
        """Return gear * clip(control, ctrl_range): (N, U); constant over the substeps of one step."""
        return np.clip(np.asarray(control, dtype=np.float64), self.lower, self.upper) * self.gear

    def joint_effort(self, geared: Array, q: Array, qd: Array) -> Array:
        """Return the actuators' effort on every joint: (N, J) [N m or N], from `geared` (N, U), `q`, `qd` (N, J)."""
        if not self.on_joint:
            return np.zeros_like(q)
        effort = geared[:, self.on_joint] * self._scale + self._offset
        effort -= self._kp * q[:, self.joint] + self._kd * qd[:, self.joint]
        limit = self.limit[self.on_joint]
        effort = np.clip(effort, -limit, limit)
        return np.clip(effort @ self._incidence, -self.joint_limit, self.joint_limit)

    def spring_effort(self, q: Array) -> Array:
        """Return the passive effort of the springs at joint positions `q` (N, J): (N, J) [N m or N]."""
        return self._stiffness * (self._rest - q)

    def thrust_size(self, geared: Array, height: Array | None = None) -> Array:
        """Return the force of every thrust actuator along its direction: (N, T) [N]; constant over a step's substeps.

        height: (N, T) [m] of the thrust links' origins at the beginning of the step, needed where `has_ceilings`.
        """
        limit = self.limit[self.on_link]
        offset = self._hover if height is None else np.where(height > self._ceiling, 0.0, self._hover)
        return np.clip(geared[:, self.on_link] + offset, -limit, limit)

    def thrust(self, geared: Array, height: Array | None = None) -> Array:
        """Return `thrust_size` as vectors in link axes: (N, T, 3) [N]."""
        return self.thrust_size(geared, height)[:, :, None] * self.thrust_direction


def control_of(robot: RobotModel) -> Callable[[Array], Array]:
    """Return what makes controls of actions (..., U) of `robot`: -1 and 1 become the ends of each control range."""
    ranges = np.array([actuator.ctrl_range for actuator in robot.actuators]).reshape(-1, 2)
    middle, half = ranges.mean(axis=1), 0.5 * (ranges[:, 1] - ranges[:, 0])
    if (ranges == (-1.0, 1.0)).all():
        return lambda action: action
    return lambda action: middle + half * action


def _target_gain(actuator: Actuator) -> float:
    """Return d effort / d (gear u) of a joint actuator."""
    return {"effort": 1.0, "position": actuator.kp, "velocity": actuator.kd}[actuator.law]


def _column(rows: list[tuple[float, float, float]], empty: tuple[int, int]) -> Array:
    return np.array(rows, dtype=float) if rows else np.zeros(empty)
