"""The order in which limits are listed is no setting: a run that is resumed with another one is the same run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from guard_algos import cpo, pcpo, trpo_fac, trpo_ipo, trpo_lagrangian
from guard_algos.checkpoint import read
from guard_algos.on_policy import OnPolicyAlgorithm
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Bandit, train

LIMITS = {"a": 4.0, "b": 1.0}
SMALL = {"steps_per_epoch": 200, "hidden": (8,), "value_iterations": 3, "threads": 1, "checkpoint_every": 2}


def run(algorithm: OnPolicyAlgorithm, folder: Path, limits: dict[str, float], steps: int) -> dict[str, np.ndarray]:
    """Train, or go on training, under `limits`; return the tensors of the last checkpoint."""
    config = algorithm.config_type(**SMALL, cost_limits=limits)
    train(algorithm, Bandit(10, 20, {"a": 1.0, "b": 0.25}), folder, config, steps, resume=folder.exists())
    path = RunDirectory.open(folder).last_checkpoint()
    assert path is not None
    return read(path, algorithm.name)[0]


@pytest.mark.parametrize(
    "algorithm",
    [module.algorithm for module in (cpo, pcpo, trpo_fac, trpo_ipo, trpo_lagrangian)],
    ids=lambda algorithm: algorithm.name,
)
def test_limits_in_another_order_are_the_same_training(tmp_path: Path, algorithm: OnPolicyAlgorithm) -> None:
    one = run(algorithm, tmp_path / "one", LIMITS, 1200)
    other = dict(reversed(LIMITS.items()))
    run(algorithm, tmp_path / "other", other, 600)
    mixed = run(algorithm, tmp_path / "other", LIMITS, 1200)
    assert one.keys() == mixed.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], mixed[name], err_msg=name)
