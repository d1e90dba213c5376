"""What the safety layers log of themselves, recomputed from the batch and from their networks before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from guard_algos import trpo_sl, trpo_usl
from tests.algos.corridor import LENGTH, Corridor
from tests.algos.recording import Epoch, record
from tests.algos.reference import Gaussian, network, to_go
from tests.algos.test_logged_numbers import EPOCHS, POLICY, SHARED, WIDTH, WORLDS

MODEL, CRITIC = (2, WIDTH, 2), (4, WIDTH, 1)


def recorded(module, folder: Path, **options) -> list[Epoch]:
    config = module.algorithm.config_type(**SHARED, **options)
    return record(module.algorithm, Corridor(WORLDS, line=0.5), folder, config, EPOCHS * LENGTH * WORLDS)


def observed(epoch: Epoch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the observations (T N, 2), executed actions (T N, 2) and costs (T, N) of an epoch."""
    rollout = epoch.batch.rollout
    executed = np.clip(rollout.executed.double().numpy(), -1, 1).reshape(-1, 2)
    return rollout.observation.double().numpy().reshape(-1, 2), executed, rollout.costs.sum(axis=2)


def test_sl_logs_its_model_s_losses_and_how_often_it_saw_no_safe_action(tmp_path: Path) -> None:
    threshold, unmet = 0.02, []
    for epoch in recorded(trpo_sl, tmp_path, threshold=threshold):
        observation, executed, cost = observed(epoch)
        before = np.concatenate([np.zeros((1, WORLDS)), cost[:-1]]).ravel()  # every episode starts with the rollout
        kinds = [kind for kind in (cost.ravel() > 0, cost.ravel() == 0) if kind.any()]
        weight = sum(kind / kind.sum() / len(kinds) for kind in kinds)
        change = {}
        for when, arrays in (("before", epoch.before), ("after", epoch.after)):
            outputs = network(arrays["method.model.cost.parameters"].astype(float), MODEL, observation)
            change[when] = (outputs * executed).sum(axis=1)
            loss = (weight * (before + change[when] - cost.ravel()) ** 2).sum()
            assert epoch.row[f"shield_cost_loss_{when}"] == pytest.approx(loss, rel=1e-4)
        predicted = before + change["before"]
        share = [(predicted > threshold + tolerance).mean() for tolerance in (2e-5, 5e-6)]  # single precision decides
        assert share[0] <= epoch.row["unmet_rate"] <= share[1]
        unmet.append(epoch.row["unmet_rate"])
    assert 0 < max(unmet) < 1


def test_usl_logs_its_critic_s_losses_and_how_often_it_is_above_the_threshold(tmp_path: Path) -> None:
    threshold, unmet = 0.1, []
    for epoch in recorded(trpo_usl, tmp_path, threshold=threshold, warmup_ratio=1.0):
        observation, executed, cost = observed(epoch)
        pairs = np.concatenate([observation, executed], axis=1)
        old = {when: arrays["method.critic.cost.parameters"].astype(float)
               for when, arrays in (("before", epoch.before), ("after", epoch.after))}  # fmt: skip
        value = network(old["before"], CRITIC, pairs)[:, 0].reshape(LENGTH, WORLDS)
        last = epoch.batch.rollout.last_observation.double().numpy()
        action = np.clip(Gaussian(epoch.before["policy"], POLICY).mean(last), -1, 1)  # uncorrected while warming up
        beyond = network(old["before"], CRITIC, np.concatenate([last, action], axis=1))
        after = np.concatenate([value[1:], beyond.T])
        target = value + to_go(cost, value, after, epoch.batch.rollout.ended, SHARED["gamma"], SHARED["gae_lambda"])
        for when, parameters in old.items():
            loss = ((network(parameters, CRITIC, pairs)[:, 0] - target.ravel()) ** 2).mean()
            assert epoch.row[f"shield_cost_loss_{when}"] == pytest.approx(loss, rel=1e-4)
        share = [(value > threshold + tolerance).mean() for tolerance in (1e-5, -1e-5)]
        assert share[0] <= epoch.row["unmet_rate"] <= share[1]
        unmet.append(epoch.row["unmet_rate"])
    assert 0 < min(unmet) < 1
