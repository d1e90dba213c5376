"""Loops over worlds that numba compiles, see `guard_api.kernels`; the plain forms are beside their callers."""

from __future__ import annotations

from typing import Any, Final

from guard_api.kernels import kernel

_BOUND: Final = "Array(float64, 3, 'C', readonly=True)"
"""What the batch binds: nobody but MuJoCo may write into it."""
_VELOCITIES: Final = "Array(float64, 2, 'A', readonly=True)"
_WARNINGS: Final = "Array(int32, 3, 'C', readonly=True)"


@kernel(
    f"{_BOUND}, {_BOUND}, {_BOUND}, {_BOUND}, int64[::1], int64[::1], int64[::1], "
    "float64[:,:], float64[:,:], int64[:,::1], float64[::1], "
    "float64[:,:,:], float64[:,:,:], float64[:,:,:], float64[:,:,:]"
)
def frames(
    xpos: Any,
    xquat: Any,
    cvel: Any,
    subtree_com: Any,
    bodies: Any,
    roots: Any,
    rows: Any,
    q: Any,
    qd: Any,
    slides: Any,
    factors: Any,
    position: Any,
    quaternion: Any,
    linear: Any,
    angular: Any,
) -> None:
    """Write the frames of `bodies` (K,) into the `rows` (K,) of the last four, as `guard_mujoco.readout` does.

    Then add what sliding joints do to massless links, as `guard_mujoco.merged` does; slides (S, 3): joint, link, axis.
    """
    for world in range(xpos.shape[0]):
        for k in range(bodies.shape[0]):
            body, root, row = bodies[k], roots[k], rows[k]
            for i in range(4):
                quaternion[world, row, i] = xquat[world, body, i]
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                position[world, row, i] = xpos[world, body, i]
                angular[world, row, i] = cvel[world, body, i]
                arm = xpos[world, body, m] - subtree_com[world, root, m]
                other_arm = xpos[world, body, j] - subtree_com[world, root, j]
                turn = cvel[world, body, j] * arm - cvel[world, body, m] * other_arm
                linear[world, row, i] = cvel[world, body, 3 + i] + turn
        for k in range(slides.shape[0]):
            joint, link, axis = slides[k, 0], slides[k, 1], slides[k, 2]
            position[world, link, axis] += factors[k] * q[world, joint]
            linear[world, link, axis] += factors[k] * qd[world, joint]


@kernel(f"{_VELOCITIES}, {_WARNINGS}, boolean[::1], float64, boolean[::1]")
def undisturbed(qvel: Any, warning: Any, ok: Any, limit: Any, verdict: Any) -> None:
    """Write the `verdict` (1,) on all worlds together, as `guard_mujoco.world` does; limit: of the sum of squares."""
    squares = 0.0
    for world in range(qvel.shape[0]):
        for k in range(qvel.shape[1]):
            squares += qvel[world, k] * qvel[world, k]
    sound = squares <= limit
    for world in range(ok.shape[0]):
        sound &= ok[world]
        for k in range(warning.shape[1]):
            sound &= warning[world, k, 0] == 0 and warning[world, k, 1] == 0
    verdict[0] = sound


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
