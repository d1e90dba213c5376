"""A transfer experiment in toy engines with a toy algorithm, and the real machinery around them."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from guard_api import plugins
from guard_api.algorithm import CHANGES_NO_NUMBER
from guard_api.measure import training, transfer
from guard_api.measure.plan import TransferPlan
from guard_api.runs.checkpoint import load_checkpoint
from guard_api.spec import EnvSpec
from guard_api.tasks import TASKS
from tests.measure.toy_environment import GAINS, Push, ToyEnvironment

SPEC = EnvSpec(name="Goal_Toy_0Hazards", robot="point", task=TASKS["Goal"](), constraints=(), episode_length=20)
EPOCHS = 4


@dataclass(frozen=True, kw_only=True)
class ToyConfig:
    cost_limit: float = 1.0
    ambition: float = 1.5
    haste: int = field(default=1, metadata=CHANGES_NO_NUMBER)


class ToyAlgorithm:
    """Pushes so that the car ends at `ambition` in its own engine, a little differently with every seed."""

    name = "toy"
    config_type = ToyConfig

    def __init__(self):
        self.log: list[tuple[str, int, int]] = []

    def train(self, job):
        gain = job.env.gain
        last = job.run.last_checkpoint() if job.resume else None
        first = int(last.name) + 1 if last else 1
        job.run.truncate_log(first - 1)
        for epoch in range(first, EPOCHS + 1):
            self.log.append((str(job.run.path.parent.name), job.seed, epoch))
            target = job.config.ambition * (1 + 0.02 * job.seed) / (20 * gain)
            strength = np.array([target * epoch / EPOCHS])
            row = {
                "epoch": epoch,
                "total_steps": 100 * epoch,
                "return_mean": float(strength[0]),
                "cost_mean": 1.0 / epoch,
                **dict.fromkeys(("cost_rate", "violation_rate", "success_mean", "steps_per_second"), 0.0),
            }
            job.run.log(row)
            job.run.save_checkpoint(epoch, {"strength": strength}, {"epoch": epoch})
            job.report(row)
            if job.should_stop() and epoch < EPOCHS:
                return False
        return True

    def load_policy(self, checkpoint):
        tensors, _ = load_checkpoint(checkpoint)
        return Push(float(tensors["strength"][0]))


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch):
    """Toy engines and the toy algorithm in the places of plugins; `versions` and `environments` can be looked at."""
    world = SimpleNamespace(algorithm=ToyAlgorithm(), versions=dict.fromkeys(GAINS, "1.0"), environments=[])

    def load(group, name):
        if group == "guard.algorithms":
            return world.algorithm
        return SimpleNamespace(name=name, versions=lambda: {name: world.versions[name]})

    def make(spec, *, backend, num_worlds, seed=0, workers=None):
        env = ToyEnvironment(backend, num_worlds, seed)
        world.environments.append(env)
        return env

    monkeypatch.setattr(os, "fsync", lambda handle: None)  # power cuts are not tested here, and waiting is slow
    monkeypatch.setattr(plugins, "load", load)
    monkeypatch.setattr(plugins, "names", lambda group: [])
    monkeypatch.setattr(training, "make_environment", make)
    monkeypatch.setattr(transfer, "make_environment", make)
    return world


@pytest.fixture
def make_plan():
    def make(**changes) -> TransferPlan:
        values = {
            "spec": SPEC,
            "algorithm": "toy",
            "config": ToyConfig(),
            "backends": ("exact", "twin", "strong"),
            "seeds": (0, 1, 2),
            "total_steps": 400,
            "num_worlds": 2,
            "episodes": 12,
            "eval_worlds": 5,
        }
        return TransferPlan(**{**values, **changes})

    return make
