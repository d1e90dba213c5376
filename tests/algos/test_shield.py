"""What both safety layers must keep: TRPO where they are off, the same bits, fewer violations, an honest log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from guard_algos import trpo, trpo_sl, trpo_usl
from guard_algos.checkpoint import read
from guard_algos.shield import ShieldConfig
from guard_api.errors import GuardError, SpecError
from guard_api.measure.rollout import evaluate
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import final_policy, train
from tests.algos.corridor import LENGTH, Corridor
from tests.algos.test_training_loop import assert_same_run, logged

LAYERS = {"trpo-sl": trpo_sl.algorithm, "trpo-usl": trpo_usl.algorithm}
SMALL: dict[str, Any] = {
    "steps_per_epoch": 200,
    "hidden": (8,),
    "value_iterations": 5,
    "threads": 1,
    "checkpoint_every": 2,
}
UPDATE = ("kl", "surrogate_improvement", "return_mean", "value_loss_after", "entropy")


def corridor(num_worlds: int = 10) -> Corridor:
    return Corridor(num_worlds, line=0.0)


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("off", [{"warmup_ratio": 1.0}, {"warmup_ratio": 0.0, "threshold": 1e6}])
def test_a_layer_that_corrects_nothing_is_trpo_bit_for_bit(tmp_path: Path, name: str, off: dict[str, float]) -> None:
    plain, layer = trpo.algorithm, LAYERS[name]
    train(plain, corridor(), tmp_path / "a", plain.config_type(**SMALL), 800)
    train(layer, corridor(), tmp_path / "b", layer.config_type(**SMALL, **off), 800)
    expected, found = logged(tmp_path / "a"), logged(tmp_path / "b")
    assert expected == [{key: row[key] for key in expected[0]} for row in found]
    a, b = final_policy(plain, tmp_path / "a"), final_policy(layer, tmp_path / "b")
    observation, costs = np.random.default_rng(0).standard_normal((100, 2)), np.zeros((100, 2))
    np.testing.assert_array_equal(a.act(observation), b.act(observation, True, costs))
    np.testing.assert_array_equal(a.act(observation, False), b.act(observation, False, costs))


@pytest.mark.parametrize("name", LAYERS)
def test_same_seed_same_bits_and_resume_across_the_end_of_the_warmup(tmp_path: Path, name: str) -> None:
    layer = LAYERS[name]
    config = layer.config_type(**SMALL, warmup_ratio=0.5, thresholds={"line": 0.01, "spare": 0.02})
    assert train(layer, corridor(), tmp_path / "whole", config, 1200)
    assert [row["shield_active"] for row in logged(tmp_path / "whole")] == [0.0] * 3 + [1.0] * 3
    assert logged(tmp_path / "whole")[-1]["corrected_rate"] > 0
    for epochs in (2, 4):  # before and after the layer begins to work
        folder = tmp_path / f"after{epochs}"
        stops = iter([False] * (epochs - 1) + [True])
        assert not train(layer, corridor(), folder, config, 1200, should_stop=lambda stops=stops: next(stops))
        assert train(layer, corridor(), folder, config, 1200, resume=True)
        assert_same_run(tmp_path / "whole", folder, name)
    path = RunDirectory.open(tmp_path / "whole").last_checkpoint()
    assert path is not None
    saved = read(path, name)[0]
    assert sum("adam" in key and key.startswith("method") for key in saved) == 2 * 3  # both networks, with optimiser
    assert int(saved["method.warmup.seen"][0]) == 1200


@pytest.mark.parametrize("name", LAYERS)
def test_a_training_asked_for_more_steps_keeps_its_warmup(tmp_path: Path, name: str) -> None:
    layer = LAYERS[name]
    config = layer.config_type(**SMALL, warmup_ratio=0.5)
    train(layer, corridor(), tmp_path, config, 400)
    train(layer, corridor(), tmp_path, config, 1600, resume=True)
    assert [row["shield_active"] for row in logged(tmp_path)] == [0.0] + [1.0] * 7


@pytest.mark.parametrize("name", LAYERS)
def test_the_log_says_what_was_corrected(tmp_path: Path, name: str) -> None:
    layer, env = LAYERS[name], corridor()
    rollouts = []
    original = layer.method.improve

    def improve(self: Any, policy: Any, theta: torch.Tensor, batch: Any, pool: Any) -> dict[str, float]:
        rollouts.append(batch.rollout)
        return original(self, policy, theta, batch, pool)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layer.method, "improve", improve)
        train(layer, env, tmp_path, layer.config_type(**SMALL, warmup_ratio=0.25), 800)
    taken = np.stack(env.taken).reshape(4, LENGTH, 10, 2)
    for row, rollout, actions in zip(logged(tmp_path), rollouts, taken, strict=True):
        np.testing.assert_allclose(actions, np.clip(rollout.executed.numpy(), -1, 1), atol=1e-7)  # what acted
        change = np.abs(actions - np.clip(rollout.action.numpy(), -1, 1)).max(axis=-1)
        assert row["corrected_rate"] == pytest.approx((change > 0).mean())
        assert row["correction_mean"] == pytest.approx(change.mean(), abs=1e-7)
        assert 0 <= row["unmet_rate"] <= 1
    assert [row["corrected_rate"] > 0 for row in logged(tmp_path)][:2] == [False, True]
    assert {f"shield_cost_loss_{t}" for t in ("before", "after")} <= logged(tmp_path)[0].keys()


@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_reduces_violations_and_keeps_what_they_do_not_forbid(tmp_path: Path, name: str) -> None:
    options = {
        "steps_per_epoch": 1000,
        "hidden": (16,),
        "gamma": 0.9,
        "target_kl": 0.05,
        "value_iterations": 30,
        "value_learning_rate": 0.01,
        "threads": 1,
    }
    extra: dict[str, Any] = {"threshold": 0.02} if name == "trpo-sl" else {"threshold": 0.1, "warmup_ratio": 0.15}
    plain, layer = trpo.algorithm, LAYERS[name]
    train(plain, Corridor(line=0.5), tmp_path / "a", plain.config_type(**options), 20_000)
    train(layer, Corridor(line=0.5), tmp_path / "b", layer.config_type(**options, **extra), 20_000)
    free = evaluate(final_policy(plain, tmp_path / "a"), Corridor(line=0.5), 100, seed=9)
    safe = evaluate(final_policy(layer, tmp_path / "b"), Corridor(line=0.5), 100, seed=9)
    assert free.cost.mean() > 5
    assert safe.cost.mean() < 0.2 * free.cost.mean()
    # Upwards the point may go as it likes, which is half of the return.
    assert safe.returns.mean() > free.returns.mean() / 3


def test_the_gradient_by_the_proposed_action_is_that_of_the_executed_return_and_by_the_executed_one_is_not() -> None:
    """One step, reward (a - 1)^2 with a = min(proposal, 0.2): the proposal is N(mean, 1)."""
    rng = np.random.default_rng(0)

    def expected(mean: float) -> float:
        proposal = mean + np.linspace(-8, 8, 200_001)
        density = np.exp(-np.square(proposal - mean) / 2) / np.sqrt(2 * np.pi)
        return float(np.sum(density * np.square(np.minimum(proposal, 0.2) - 1)) * 16 / 200_000)

    mean = 0.3
    true = (expected(mean + 1e-4) - expected(mean - 1e-4)) / 2e-4
    proposed = mean + rng.standard_normal(400_000)
    executed = np.minimum(proposed, 0.2)
    reward = np.square(executed - 1)
    by_proposed = ((proposed - mean) * (reward - reward.mean())).mean()
    by_executed = ((executed - mean) * (reward - reward.mean())).mean()
    assert by_proposed == pytest.approx(true, rel=0.02)
    assert by_executed != pytest.approx(true, rel=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"warmup_ratio": 1.5}, "warmup_ratio = 1.5"),
        ({"threshold": -0.1}, "threshold of 'threshold' = -0.1"),
        ({"thresholds": {"line": float("nan")}}, "threshold of 'line' = nan"),
        ({"correction_rate": 0.0}, "correction_rate = 0.0"),
        ({"correction_iterations": 0}, "correction_iterations = 0"),
    ],
)
def test_options_that_mean_nothing_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        trpo_usl.TrpoUslConfig(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"thresholds": {"lines": 1.0}}, "did you mean line"),
        ({"thresholds": {"line": 1.0}, "threshold": 1.0}, "set only one"),
    ],
)
def test_thresholds_that_do_not_fit_the_environment_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(GuardError, match=message):
        ShieldConfig(**options).signals(("line", "spare"))
