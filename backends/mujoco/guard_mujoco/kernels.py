"""Loops over worlds that numba compiles, see `guard_api.kernels`; the plain forms are beside their callers."""

from __future__ import annotations

from typing import Any, Final

from guard_api.kernels import kernel

_BOUND: Final = "Array(float64, 3, 'C', readonly=True)"
"""What the batch binds: nobody but MuJoCo may write into it."""


@kernel(
    f"{_BOUND}, {_BOUND}, {_BOUND}, {_BOUND}, int64[::1], int64[::1], int64[::1], "
    "float64[:,:,::1], float64[:,:,::1], float64[:,:,::1], float64[:,:,::1]"
)
def frames(
    xpos: Any,
    xquat: Any,
    cvel: Any,
    subtree_com: Any,
    bodies: Any,
    roots: Any,
    rows: Any,
    position: Any,
    quaternion: Any,
    linear: Any,
    angular: Any,
) -> None:
    """Write the frames of `bodies` (K,) into the `rows` (K,) of the last four, as `guard_mujoco.readout` does."""
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


@kernel("float64[:,:], float64[:,:], int64[:,::1], float64[::1], float64[:,:,:], float64[:,:,:]")
def slide(q: Any, qd: Any, slides: Any, factors: Any, position: Any, linear: Any) -> None:
    """Add what sliding joints do to links, as `guard_mujoco.merged` does; slides (K, 3): joint, link, axis."""
    for world in range(q.shape[0]):
        for k in range(slides.shape[0]):
            joint, link, axis = slides[k, 0], slides[k, 1], slides[k, 2]
            position[world, link, axis] += factors[k] * q[world, joint]
            linear[world, link, axis] += factors[k] * qd[world, joint]


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
