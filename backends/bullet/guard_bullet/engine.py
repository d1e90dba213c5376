"""The engine itself: imported and connected without its banners, but never without its errors."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from guard_api.errors import BackendError
from guard_api.scene.spec import SceneSpec

_LIBC = ctypes.CDLL(None)


@contextmanager
def quiet() -> Iterator[None]:
    """Hold back what native code prints on stdout and stderr; show it after all when the block raises."""
    sys.stdout.flush()
    sys.stderr.flush()
    _LIBC.fflush(None)
    kept = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as spool:
        os.dup2(spool.fileno(), 1)
        os.dup2(spool.fileno(), 2)
        failed = True
        try:
            yield
            failed = False
        finally:
            _LIBC.fflush(None)
            for stream, descriptor in enumerate(kept, start=1):
                os.dup2(descriptor, stream)
                os.close(descriptor)
            if failed:
                spool.seek(0)
                sys.stderr.write(spool.read().decode(errors="replace"))


with quiet():
    import pybullet  # pyright: ignore[reportMissingImports]  # a binary module without stubs

RIGID_ERP = 0.05
"""Share of a penetration, or of a joint's way beyond its stop, that the solver removes per step, by a velocity that
stays; the engine's defaults are 0.08 and 0.2."""

SOFTNESS = 1e-6
"""Constraint force mixing of the direct solver."""

Client = int
"""Number of one engine instance of this process."""


def connect(scene: SceneSpec) -> Client:
    """Return a new engine instance with the scene's timestep, gravity and solver settings, and nothing in it.

    Raises BackendError when the engine gives none (memory, or its limit of instances).
    """
    try:
        with quiet():
            client = pybullet.connect(pybullet.DIRECT)
    except pybullet.error as problem:
        raise BackendError(f"bullet: no further engine instance: {problem}; use fewer worlds per process") from problem
    if client < 0:
        raise BackendError("bullet: no further engine instance; use fewer worlds per process")
    pybullet.setTimeStep(scene.timestep, physicsClientId=client)
    pybullet.setGravity(*scene.gravity, physicsClientId=client)
    # Pairs sorted by body, not by memory address: the order of contacts decides the last bits.
    pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, enableFileCaching=0, physicsClientId=client)
    if scene.preset == "rigid":
        pybullet.setPhysicsEngineParameter(contactERP=RIGID_ERP, erp=RIGID_ERP, physicsClientId=client)
    return client


def solve_directly(client: Client) -> None:
    """Let the engine solve its constraints by elimination instead of iteration.

    A gear between a leg of grams and its rotor and a contact at its foot are nearly the same constraint: iterating over
    them takes thousands of rounds. The softness keeps the matrix regular where constraints repeat each other.
    """
    with quiet():
        pybullet.setPhysicsEngineParameter(
            constraintSolverType=pybullet.CONSTRAINT_SOLVER_LCP_DANTZIG, globalCFM=SOFTNESS, physicsClientId=client
        )


def disconnect(client: Client) -> None:
    """Free an engine instance; one that is gone already is no error."""
    with suppress(pybullet.error):
        pybullet.disconnect(physicsClientId=client)
