"""Mass matrix, bias force and acceleration of one robot, over all worlds at once: the reference for every engine.

All spatial vectors are in world axes about one point per world (the base of a floating robot, else the origin of
its root link), angular part first, so that the recursions are plain sums along the tree. That point follows the
robot, which keeps the sums accurate far from the world's origin.

Coordinates are those of `guard_api.physics.state.Inspection`: the joints, after base linear and base angular velocity
(world axes, at the link-frame origin) where the base floats. Arrays inside are components first and worlds last;
world i gets the same bits whatever N is, for which no linear-algebra library is called.

Source: Featherstone 2008, Rigid Body Dynamics Algorithms: recursive Newton-Euler (chapter 5), composite rigid bodies
(chapter 6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from guard_api.conventions import GRAVITY
from guard_api.model.kinematics import Kinematics, LinkPoses, cross, rows_of
from guard_api.model.robot import RobotModel
from guard_api.shapes import Vector3

Array = NDArray[np.float64]


class _Bodies(NamedTuple):
    """Spatial inertias about the reference point: mass (K, 1), mass * com (3, K, N), second moment (3, 3, K, N)."""

    mass: Array
    moment: Array
    inertia: Array

    def momentum(self, motion: Array) -> Array:
        """Return the momenta (6, K, N) of the bodies moving with `motion` (6, K, N)."""
        angular, linear = motion[:3], motion[3:]
        spin = np.add.reduce(self.inertia * angular, axis=1) + cross(self.moment, linear)
        return np.concatenate([spin, self.mass * linear + cross(angular, self.moment)])


class Dynamics:
    """The equations of motion of `robot` under `gravity` (3,) [m/s^2]: M a + bias = effort.

    kinematics: computes the `poses` that the methods take. num_coordinates: D = J, or 6 + J with a floating base.
    """

    def __init__(self, robot: RobotModel, gravity: Vector3 = GRAVITY) -> None:
        self.kinematics = kinematics = Kinematics(robot)
        self._floating = robot.floating
        self._gravity = np.array(gravity)[:, None]
        links = [robot.links[index] for index in kinematics.order]
        self._mass = np.array([link.mass for link in links])[:, None]
        self._com = np.array([link.com for link in links]).T[:, :, None]
        self._inertia = np.array([link.inertia for link in links]).transpose(1, 2, 0)[..., None]
        self._frames = rows_of(kinematics.frames, broadcast=True)
        self._reference = 0 if robot.floating else kinematics.order.index(robot.link_index(robot.root))
        self._towards_base = _towards_base(kinematics)

        num_base = 6 if robot.floating else 0
        self.num_coordinates = num_base + len(robot.joints)
        self._coordinates = np.concatenate([np.arange(num_base), num_base + kinematics.joints])
        self._rows = np.concatenate([np.zeros(num_base, np.intp), np.arange(1, len(links))])
        self._above, self._below = _ancestor_pairs(self._rows, kinematics.parents)
        self._damping = np.zeros((self.num_coordinates, 1))
        self._damping[num_base:, 0] = [joint.damping for joint in robot.joints]
        self._armature = np.zeros((self.num_coordinates, 1))
        self._armature[num_base:, 0] = [joint.armature for joint in robot.joints]

        thrusters = [actuator for actuator in robot.actuators if actuator.law == "thrust"]
        self._thrust_rows = [kinematics.order.index(robot.link_index(str(t.link))) for t in thrusters]
        self._thrust_points = np.array([t.point for t in thrusters]).reshape(-1, 3).T[:, :, None]

    def mass_matrix(self, poses: LinkPoses) -> Array:
        """Return M (N, D, D), armature included."""
        return np.ascontiguousarray(self._mass_matrix(self._motions(poses), self._bodies(poses)).transpose(2, 0, 1))

    def bias_force(self, poses: LinkPoses, base_linear: Array, base_angular: Array, qd: Array) -> Array:
        """Return the Coriolis, centrifugal and gravity force (N, D); springs belong to the actuation law.

        base_linear, base_angular: (N, 3) of the first link, read only if it floats. qd: (N, J).
        """
        motions, bodies = self._motions(poses), self._bodies(poses)
        force = self._link_forces(motions, bodies, base_linear, base_angular, qd)
        return np.ascontiguousarray(self._project(motions, force).T)

    def acceleration(
        self, poses: LinkPoses, base_linear: Array, base_angular: Array, qd: Array, *, effort: Array, thrust: Array,
        timestep: float,
    ) -> Array:  # fmt: skip
        """Return the acceleration a (N, D): (M + h D) a = effort + J^T thrust - D qd - bias; no dry friction.

        effort: (N, J) of actuators and springs; thrust: (N, T, 3) [N] of the thrust actuators in link axes; D: joint
        damping.
        Where the matrix is singular or an input is not finite, that world's result is not finite; nothing is raised.
        """
        matrix, right = self.equations(
            poses, base_linear, base_angular, qd, effort=effort, thrust=thrust, timestep=timestep
        )
        return np.ascontiguousarray(solve(matrix, right[:, None])[:, 0].T)

    def equations(
        self, poses: LinkPoses, base_linear: Array, base_angular: Array, qd: Array, *, effort: Array, thrust: Array,
        timestep: float,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the matrix (D, D, N) and the right side (D, N) of `acceleration`'s equation, worlds last."""
        motions, bodies = self._motions(poses), self._bodies(poses)
        force = self._link_forces(motions, bodies, base_linear, base_angular, qd)
        self._subtract_thrust(force, poses, thrust)
        right = -self._project(motions, force)
        joints = slice(self.num_coordinates - qd.shape[1], None)
        right[joints] += effort.T - self._damping[joints] * qd.T
        matrix = self._mass_matrix(motions, bodies)
        diagonal = np.arange(self.num_coordinates)
        matrix[diagonal, diagonal] += timestep * self._damping
        return matrix, right

    def _motions(self, poses: LinkPoses) -> Array:
        """Return the motion of unit speed of every coordinate: (6, D, N), ordered base, then joints by depth."""
        arm = poses.origin[:, 1:] - poses.origin[:, self._reference, None]
        axes, slides = self.kinematics.axes(poses), self.kinematics.slides
        joints = np.concatenate([np.where(slides, 0.0, axes), np.where(slides, axes, cross(arm, axes))])
        if not self._floating:
            return joints
        base = np.roll(np.eye(6), 3, axis=0)[:, :, None]  # linear coordinates first, angular components first
        return np.concatenate([np.broadcast_to(base, (6, 6, joints.shape[2])), joints], axis=1)

    def _bodies(self, poses: LinkPoses) -> _Bodies:
        """Return the spatial inertias of the links in world axes, by depth."""
        R = poses.rotation[:, :, self._frames]
        com = poses.origin - poses.origin[:, self._reference, None] + np.add.reduce(R * self._com, axis=1)
        turned = np.add.reduce(R[:, :, None] * self._inertia, axis=1)
        inertia = np.add.reduce(turned[:, None] * R, axis=2)
        moment = self._mass * com
        inertia = inertia - moment[:, None] * com
        inertia[[0, 1, 2], [0, 1, 2]] += np.add.reduce(moment * com, axis=0)
        return _Bodies(self._mass, moment, inertia)

    def _mass_matrix(self, motions: Array, bodies: _Bodies) -> Array:
        """Return M (D, D, N): the force that moves every composite body, felt by each coordinate above it."""
        parts = (bodies.mass.copy(), bodies.moment.copy(), bodies.inertia.copy())
        for rows, parents in self._towards_base:
            for part in parts:
                part[..., parents, :] += part[..., rows, :]
        mass, moment, inertia = (part[..., self._rows, :] for part in parts)
        momentum = _Bodies(mass, moment, inertia).momentum(motions)
        entries = np.add.reduce(motions[:, self._above] * momentum[:, self._below], axis=0)
        M = np.zeros((self.num_coordinates, self.num_coordinates, motions.shape[2]))
        i, j = self._coordinates[self._above], self._coordinates[self._below]
        M[i, j] = entries
        M[j, i] = entries
        diagonal = np.arange(self.num_coordinates)
        M[diagonal, diagonal] += self._armature
        return M

    def _link_forces(
        self, motions: Array, bodies: _Bodies, base_linear: Array, base_angular: Array, qd: Array
    ) -> Array:
        """Return the force (6, K, N) that each link needs at zero acceleration of the coordinates, gravity included."""
        joint_motions = motions[:, 6:] if self._floating else motions
        velocity, acceleration = np.empty((2, 6, len(self.kinematics.order), len(qd)))
        velocity[:, 0] = np.concatenate([base_angular.T, base_linear.T]) if self._floating else 0.0
        acceleration[:3, 0], acceleration[3:, 0] = 0.0, -self._gravity
        if self._floating:  # a point fixed in space sees the base coordinates' axes move
            acceleration[3:, 0] += cross(base_linear.T, base_angular.T)
        step = joint_motions * self.kinematics.coordinates(qd)
        self.kinematics.accumulate(velocity, step)
        carrier = velocity[:, self.kinematics.parents]
        turned = [cross(carrier[:3], step[:3]), cross(carrier[:3], step[3:]) + cross(carrier[3:], step[:3])]
        self.kinematics.accumulate(acceleration, np.concatenate(turned))
        momentum, force = bodies.momentum(velocity), bodies.momentum(acceleration)
        force[:3] += cross(velocity[:3], momentum[:3]) + cross(velocity[3:], momentum[3:])
        force[3:] += cross(velocity[:3], momentum[3:])
        return force

    def _subtract_thrust(self, force: Array, poses: LinkPoses, thrust: Array) -> None:
        for k, row in enumerate(self._thrust_rows):
            R = poses.rotation[:, :, self.kinematics.frames[row]]
            pull = np.add.reduce(R * thrust[:, k].T, axis=1)
            arm = poses.origin[:, row] - poses.origin[:, self._reference]
            arm = arm + np.add.reduce(R * self._thrust_points[:, k], axis=1)
            force[:, row] -= np.concatenate([cross(arm, pull), pull])

    def _project(self, motions: Array, force: Array) -> Array:
        """Return what every coordinate feels of the forces (6, K, N) on the links that it moves: (D, N)."""
        total = force.copy()
        for rows, parents in self._towards_base:
            total[:, parents] += total[:, rows]
        felt = np.empty(motions.shape[1:])
        felt[self._coordinates] = np.add.reduce(motions * total[:, self._rows], axis=0)
        return felt


def solve(matrix: Array, right: Array) -> Array:
    """Return x (D, C, N) with matrix x = right by elimination; `matrix` (D, D, N) is symmetric positive definite."""
    size = len(matrix)
    both = np.concatenate([matrix, right], axis=1)
    for k in range(size - 1):
        factor = both[k + 1 :, k] / both[k, k]
        both[k + 1 :, k + 1 :] -= factor[:, None] * both[k, k + 1 :]
    x = both[:, size:]
    for k in reversed(range(size)):
        x[k] /= both[k, k]
        x[:k] -= both[:k, k, None] * x[k]
    return x


def _towards_base(kinematics: Kinematics) -> list[tuple[slice | NDArray[np.intp], slice | NDArray[np.intp]]]:
    """Return (rows, parents) to add up in turn so that every link holds the sum over its subtree, deepest first.

    Siblings come in separate turns, since an indexed addition counts a repeated parent once.
    """
    turns = []
    for level in reversed(kinematics.levels):
        waiting = list(range(level.rows.start, level.rows.stop))
        while waiting:
            eldest = {kinematics.parents[row - 1]: row for row in reversed(waiting)}
            rows = sorted(eldest.values())
            turns.append((rows_of(rows), rows_of(kinematics.parents[[row - 1 for row in rows]])))
            waiting = [row for row in waiting if row not in rows]
    return turns


def _ancestor_pairs(rows: NDArray[np.intp], parents: NDArray[np.intp]) -> tuple[list[int], list[int]]:
    """Return coordinates (i, j) such that i moves everything that j moves, by the link `rows` that they move."""
    above, below = [], []
    for j, row in enumerate(rows):
        ancestors, link = {int(row)}, int(row)
        while link > 0:
            link = int(parents[link - 1])
            ancestors.add(link)
        for i, other in enumerate(rows[: j + 1]):
            if int(other) in ancestors:
                above.append(i)
                below.append(j)
    return above, below
