"""What a world must remember besides PhysX's own state, and both of them as bytes."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.physics.state import Array
from guard_api.scene.spec import SceneSpec

_DIGEST = 32


class Record:
    """Counters and readouts of N worlds, in arrays that the world updates in place.

    substeps (N,): done since reset; time is counted here, because PhysX's timestep is a float32.
    last_substeps (N,): of the last step. ok (N,): False until the first reset.
    control (N, U): last accepted control. effort (N, J) [N m or N]: actuator effort of the last substep.
    impulse (N, K) [N s]: normal impulse that the touch sensors counted in the last step. touched (N, B): body contacts
    in it.
    """

    def __init__(self, spec: SceneSpec, num_worlds: int) -> None:
        robot = spec.robot
        controls, joints, touch = (
            (len(robot.actuators), len(robot.joints), len(robot.touch_sensors)) if robot else (0, 0, 0)
        )
        self.substeps = np.zeros(num_worlds, np.int64)
        self.last_substeps = np.ones(num_worlds, np.int64)
        self.ok = np.zeros(num_worlds, bool)
        self.control = np.zeros((num_worlds, controls))
        self.effort = np.zeros((num_worlds, joints))
        self.impulse = np.zeros((num_worlds, touch))
        self.touched = np.zeros((num_worlds, spec.num_bodies), bool)

    def clear(self, worlds: NDArray[np.intp]) -> None:
        """Forget everything of `worlds` but whether they are ok."""
        for array in (self.substeps, self.control, self.effort, self.impulse, self.touched):
            array[worlds] = 0
        self.last_substeps[worlds] = 1

    def time(self, timestep: float) -> Array:
        """Return the time since reset: (N,) [s], exact to float64."""
        return np.multiply(self.substeps, timestep, dtype=float)

    def mean_touch(self, timestep: float) -> Array:
        """Return the normal force on the touch sensors, averaged over the last step: (N, K) [N]."""
        return self.impulse / (timestep * self.last_substeps)[:, None]

    def arrays(self) -> list[np.ndarray]:
        """Return every array, in a fixed order."""
        return [self.substeps, self.last_substeps, self.ok, self.control, self.effort, self.impulse, self.touched]


def fingerprint(spec: SceneSpec, num_worlds: int) -> bytes:
    """Return 32 bytes that equal worlds share."""
    return hashlib.sha256(f"guard_sapien 1|{num_worlds}|{spec!r}".encode()).digest()


def to_bytes(mark: bytes, arrays: list[np.ndarray]) -> bytes:
    """Return `arrays` behind the fingerprint `mark`."""
    return mark + b"".join(array.tobytes() for array in arrays)


def from_bytes(mark: bytes, blob: bytes, arrays: list[np.ndarray]) -> None:
    """Fill `arrays` in place with what `to_bytes` wrote. Raises BackendError for the blob of another world."""
    if blob[:_DIGEST] != mark or len(blob) != _DIGEST + sum(array.nbytes for array in arrays):
        raise BackendError(
            "snapshot is not one of this scene and number of worlds on SAPIEN: restore it where it was taken"
        )
    at = _DIGEST
    for array in arrays:
        array[...] = np.frombuffer(blob, array.dtype, array.size, at).reshape(array.shape)
        at += array.nbytes
