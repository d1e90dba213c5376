"""Loops over worlds that numba compiles, see `guard_api.kernels`; the plain forms are beside their callers."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from guard_api.kernels import kernel

_BOUND: Final = "Array(float64, 3, 'C', readonly=True)"
"""What the batch binds: nobody but MuJoCo may write into it."""
_STATE: Final = "Array(float64, 2, 'A', readonly=True)"
_FORCES: Final = "Array(float64, 2, 'C', readonly=True)"
_WARNINGS: Final = "Array(int32, 3, 'C', readonly=True)"


@kernel(
    f"{_BOUND}, {_BOUND}, {_BOUND}, {_BOUND}, {_STATE}, {_STATE}, int64[:,::1], int64[:,::1], float64[:,::1], "
    "int64[:,::1], float64[::1], float64[:,:,::1], float64[:,:,::1]"
)
def frames(
    xpos: Any,
    xquat: Any,
    cvel: Any,
    subtree_com: Any,
    qpos: Any,
    qvel: Any,
    where: Any,
    columns: Any,
    rest: Any,
    slides: Any,
    factors: Any,
    joints: Any,
    block: Any,
) -> None:
    """Write the `joints` (2, N, J) and the frames in `block` (N, K, 13), as `guard_mujoco.readout` does.

    where (3, M): body, root, row; columns (2, J); rest (K, 13). Then add what sliding joints do to massless links, as
    `guard_mujoco.merged` does; slides (S, 3): joint, link, axis. A frame: position, quaternion, linear and angular
    velocity.
    """
    for world in range(xpos.shape[0]):
        for k in range(columns.shape[1]):
            joints[0, world, k] = qpos[world, columns[0, k]]
            joints[1, world, k] = qvel[world, columns[1, k]]
        block[world] = rest
        for k in range(where.shape[1]):
            body, root, frame = where[0, k], where[1, k], block[world, where[2, k]]
            for i in range(4):
                frame[3 + i] = xquat[world, body, i]
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                frame[i] = xpos[world, body, i]
                frame[10 + i] = cvel[world, body, i]
                arm = xpos[world, body, m] - subtree_com[world, root, m]
                other_arm = xpos[world, body, j] - subtree_com[world, root, j]
                turn = cvel[world, body, j] * arm - cvel[world, body, m] * other_arm
                frame[7 + i] = cvel[world, body, 3 + i] + turn
        for k in range(slides.shape[0]):
            joint, link, axis = slides[k, 0], slides[k, 1], slides[k, 2]
            block[world, link, axis] += factors[k] * joints[0, world, joint]
            block[world, link, 7 + axis] += factors[k] * joints[1, world, joint]


@kernel(
    "int64[:,::1], float64[:,::1], float64[:,:], float64[:,:], "
    "float64[:,:,:], float64[:,:,:], float64[:,:,:], float64[:,:,:]"
)
def chained(
    places: Any, mounts: Any, q: Any, qd: Any, position: Any, quaternion: Any, linear: Any, angular: Any
) -> None:
    """Write the frames (N, L, ...) of massless links from those of their parents, as `guard_mujoco.merged` does.

    places (M, 4): link, parent, joint, whether it slides, parents first; mounts (M, 10): position and quaternion of the
    joint in the parent's axes, and its axis. q, qd (N, J).
    """
    turns, arm, axis = np.empty((2, 4)), np.empty(3), np.empty(3)
    for world in range(q.shape[0]):
        for m in range(places.shape[0]):
            link, parent, joint, slides = places[m, 0], places[m, 1], places[m, 2], places[m, 3]
            half = 0.0 if slides else 0.5 * q[world, joint]
            turns[0] = mounts[m, 3:7]
            turns[1, 0], turns[1, 1:] = math.cos(half), math.sin(half) * mounts[m, 7:]
            whole = quaternion[world, link]
            whole[:] = quaternion[world, parent]
            for turn in range(2):
                # Rotate the arm by the parent, and the axis by the joint's frame, before the next turn.
                w, x, y, z = whole[0], whole[1], whole[2], whole[3]
                R = (
                    (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
                    (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
                    (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
                )
                vector, first = (arm, 0) if turn == 0 else (axis, 7)
                for i in range(3):
                    a, b, c = R[i]
                    vector[i] = a * mounts[m, first] + b * mounts[m, first + 1] + c * mounts[m, first + 2]
                e, f, g, h = turns[turn, 0], turns[turn, 1], turns[turn, 2], turns[turn, 3]
                whole[0], whole[1] = w * e - x * f - y * g - z * h, w * f + x * e + y * h - z * g
                whole[2], whole[3] = w * g - x * h + y * e + z * f, w * h + x * g - y * f + z * e
            for i in range(3):
                if slides:
                    arm[i] += axis[i] * q[world, joint]
                position[world, link, i] = position[world, parent, i] + arm[i]
                angular[world, link, i] = angular[world, parent, i] + (0.0 if slides else axis[i] * qd[world, joint])
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                swing = angular[world, parent, j] * arm[k] - angular[world, parent, k] * arm[j]
                along = axis[i] * qd[world, joint] if slides else 0.0
                linear[world, link, i] = linear[world, parent, i] + swing + along


@kernel(
    f"{_STATE}, {_WARNINGS}, {_FORCES}, int64[:,::1], float64[::1], boolean[::1], float64, float64[:,::1], boolean[::1]"
)
def aftermath(
    qvel: Any,
    warning: Any,
    force: Any,
    servos: Any,
    limit: Any,
    ok: Any,
    speed_limit: Any,
    effort: Any,
    verdict: Any,
) -> None:
    """Write the `effort` (N, J) and the `verdict` (1,) on all worlds together, as `guard_mujoco.aftermath` does.

    servos (2, K): actuator and joint; speed_limit: of the sum of squares.
    """
    squares, sound = 0.0, True
    for world in range(qvel.shape[0]):
        for k in range(qvel.shape[1]):
            squares += qvel[world, k] * qvel[world, k]
        sound &= ok[world]
        for k in range(warning.shape[1]):
            sound &= warning[world, k, 0] == 0 and warning[world, k, 1] == 0
        if ok[world]:
            effort[world] = 0.0
            for k in range(servos.shape[1]):
                effort[world, servos[1, k]] += force[world, servos[0, k]]
            for j in range(limit.shape[0]):
                effort[world, j] = min(max(effort[world, j], -limit[j]), limit[j])
    verdict[0] = sound and squares <= speed_limit


@kernel("float64[:,:], int64, int64, int64, int64[::1], int64[::1], float64[:,::1]")
def ring_sums(history: Any, cursor: int, substeps: int, samples: int, first: Any, stride: Any, total: Any) -> None:
    """Write the sums (n, S) over the newest `substeps` of `samples` in rings, as `guard_mujoco.history` does.

    history (n, H), with the place of the newest sample in column `cursor`; first, stride (S,).
    """
    for world in range(history.shape[0]):
        oldest = int(history[world, cursor]) + 1 - substeps
        for s in range(first.shape[0]):
            added = 0.0
            for k in range(oldest, oldest + substeps):
                added += history[world, first[s] + (k % samples) * stride[s]]
            total[world, s] = added
