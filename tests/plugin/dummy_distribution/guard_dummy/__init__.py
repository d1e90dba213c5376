"""A third party's backend: it inherits nothing and computes with the building blocks of `ideal`."""

from __future__ import annotations

import os
import signal

import numpy as np

from guard_api.conventions import BACKEND_API
from guard_api.physics.backend import Capabilities
from guard_api.testing.ideal.world import IdealWorld

BREAKING, DYING, TALKING, HANGING = 100.0, 200.0, 300.0, 400.0
"""First control of a world that makes this engine raise, die, print to its output stream, or never return."""


class DummyBackend:
    name = "dummy"
    api_version = BACKEND_API
    capabilities = Capabilities(contacts=False)

    def versions(self):
        return {"guard-dummy": "1.0"}

    def build(self, scene, num_worlds, threads=1):
        return DummyWorld(scene, num_worlds)


class DummyWorld:
    """An `ideal` world whose engine fails on demand."""

    def __init__(self, scene, num_worlds):
        self._ideal = IdealWorld(scene, num_worlds)
        self.scene, self.num_worlds, self.approximations = scene, num_worlds, ("made for tests",)
        self.reset, self.drive, self.state = self._ideal.reset, self._ideal.drive, self._ideal.state
        self.snapshot, self.restore, self.inspect = self._ideal.snapshot, self._ideal.restore, self._ideal.inspect

    def step(self, control, substeps):
        demands = set(np.asarray(control)[:, 0])
        if BREAKING in demands:
            raise RuntimeError("the dummy engine broke")
        if DYING in demands:
            os.kill(os.getpid(), signal.SIGKILL)
        if TALKING in demands:
            print("engine chatter")
        while HANGING in demands:
            signal.pause()
        self._ideal.step(control, substeps)

    def step_raw(self, substeps):
        self._ideal.step_raw(substeps)

    def close(self):
        pass


backend = DummyBackend()
