"""Loops over worlds that numba compiles, see `guard_api.kernels`; the plain forms are beside their callers."""

from __future__ import annotations

from typing import Any, Final

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
