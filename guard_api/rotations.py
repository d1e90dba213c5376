"""Quaternion arithmetic over leading batch dimensions; quaternions are (w, x, y, z)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Row by row, the two products of quaternion components in each entry of a rotation matrix.
_FIRST = np.array([[2, 1, 1, 1, 1, 2, 1, 2, 1], [2, 2, 3, 2, 1, 3, 3, 3, 1]])
_SECOND = np.array([[3, 0, 0, 0, 3, 0, 0, 0, 2], [3, 3, 2, 3, 3, 1, 2, 1, 2]])
_FIRST_SIGN = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0, -1.0])[:, None]
_SECOND_SIGN = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, -1.0])[:, None]
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
_HALF_IDENTITY = 0.5 * np.eye(3).reshape(9, 1)


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the quaternion product a b: `(..., 4)`, the rotation b followed by a."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, float), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, float), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(q: ArrayLike) -> Array:
    """Return the inverse of a unit quaternion: `(..., 4)`."""
    return np.asarray(q, float) * np.array([1.0, -1.0, -1.0, -1.0])


def to_matrix(q: ArrayLike) -> Array:
    """Return the rotation matrix `(..., 3, 3)` whose columns are the rotated axes."""
    q = np.asarray(q, float)
    # R = 2 (1/2 + a + b), with a and b products of two components each: few calls on long rows, because this runs at
    # every step for every link that is looked at.
    rows = np.ascontiguousarray(q.reshape(-1, 4).T)
    R = rows.take(_FIRST[0], axis=0) * rows.take(_FIRST[1], axis=0)
    R *= _FIRST_SIGN
    second = rows.take(_SECOND[0], axis=0) * rows.take(_SECOND[1], axis=0)
    second *= _SECOND_SIGN
    R += second
    R += _HALF_IDENTITY
    R *= 2.0
    return np.ascontiguousarray(R.T).reshape(*q.shape[:-1], 3, 3)


def from_matrix(R: ArrayLike) -> Array:
    """Return the unit quaternion `(4,)`, w >= 0, of one rotation matrix `(3, 3)`."""
    R = np.asarray(R, float)
    # The largest component is computed from its square, so no division is by a small number.
    squares = np.array([1 + R[0, 0] + R[1, 1] + R[2, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2],
                        1 - R[0, 0] + R[1, 1] - R[2, 2], 1 - R[0, 0] - R[1, 1] + R[2, 2]])  # fmt: skip
    differences = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sums = {(1, 2): R[0, 1] + R[1, 0], (1, 3): R[0, 2] + R[2, 0], (2, 3): R[1, 2] + R[2, 1]}
    k = int(np.argmax(squares))
    q = np.empty(4)
    for i in range(4):
        if i == k:
            q[i] = squares[k]
        elif 0 in {i, k}:
            q[i] = differences[max(i, k) - 1]
        else:
            q[i] = sums[min(i, k), max(i, k)]
    q /= np.linalg.norm(q)
    return -q if q[0] < 0 else q


def from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return the rotation by `angle` `(...)` [rad] about the unit `axis` `(..., 3)`: `(..., 4)`."""
    half = 0.5 * np.asarray(angle, float)[..., None]
    vector = np.sin(half) * np.asarray(axis, float)
    return np.concatenate([np.broadcast_to(np.cos(half), (*vector.shape[:-1], 1)), vector], axis=-1)


def from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the quaternion `(4,)` of URDF's roll, pitch, yaw [rad]: fixed axes x, then y, then z."""
    x, y, z = np.eye(3)
    qx, qy, qz = from_axis_angle(x, roll), from_axis_angle(y, pitch), from_axis_angle(z, yaw)
    return multiply(qz, multiply(qy, qx))


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Return the vectors `(..., 3)` v turned by q `(..., 4)`: link axes to world axes."""
    q, v = np.asarray(q, float), np.asarray(v, float)
    u, w = q[..., 1:], q[..., :1]
    t = 2.0 * cross(u, v)
    return v + w * t + cross(u, t)


def unrotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Return the vectors `(..., 3)` v turned by the inverse of q `(..., 4)`: world axes to link axes."""
    return rotate(conjugate(q), v)


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """Return a x b: `(..., 3)`; `numpy.cross` without its per-call overhead, which dominates small batches."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.shape != b.shape:
        a, b = np.broadcast_arrays(a, b)
    a, b = np.ascontiguousarray(a.T), np.ascontiguousarray(b.T)
    product = a.take(_NEXT, axis=0) * b.take(_LAST, axis=0)
    product -= a.take(_LAST, axis=0) * b.take(_NEXT, axis=0)
    return product.T


def yaw_quaternion(yaw: ArrayLike) -> Array:
    """Return the rotation by `yaw` `(...)` [rad] about world z: `(..., 4)`."""
    half = 0.5 * np.asarray(yaw, float)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)
