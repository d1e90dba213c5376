"""The loop around the update: what is logged, checkpointed, resumed and refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from guard_algos import cpo, pcpo, trpo, trpo_fac, trpo_ipo, trpo_lagrangian, trpo_sl, trpo_usl
from guard_algos.checkpoint import read
from guard_algos.config import OnPolicyConfig
from guard_api.errors import GuardError, RunError, SpecError
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Bandit, Script, final_policy, train

ALGORITHMS = {
    module.algorithm.name: module.algorithm for module in (trpo, trpo_lagrangian, trpo_fac, trpo_ipo, cpo, pcpo)
}
NEEDED: dict[str, dict[str, Any]] = {"trpo-ipo": {"cost_limit": 9.0}}
"""Options without which an algorithm does not start."""
SMALL: dict[str, Any] = {
    "steps_per_epoch": 200,
    "hidden": (8,),
    "value_iterations": 3,
    "threads": 1,
    "checkpoint_every": 2,
}
TIMES = {"time_rollout", "time_update", "steps_per_second"}


def bandit(seed: int = 0) -> Bandit:
    return Bandit(10, 20, {"a": 1.0, "b": 0.25}, seed)


def logged(folder: Path) -> list[dict[str, float]]:
    return [{k: v for k, v in row.items() if k not in TIMES} for row in RunDirectory.open(folder).rows()]


def checkpoints(folder: Path, name: str) -> dict[str, np.ndarray]:
    path = RunDirectory.open(folder).last_checkpoint()
    assert path is not None
    return read(path, name)[0]


def assert_same_run(a: Path, b: Path, name: str) -> None:
    assert logged(a) == logged(b)
    left, right = checkpoints(a, name), checkpoints(b, name)
    assert left.keys() == right.keys()
    for key in left:
        np.testing.assert_array_equal(left[key], right[key], err_msg=key)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_same_seed_same_bits_and_resume_is_the_uninterrupted_run(tmp_path: Path, name: str) -> None:
    algorithm = ALGORITHMS[name]
    config = algorithm.config_type(**SMALL, **NEEDED.get(name, {}))
    assert train(algorithm, bandit(), tmp_path / "whole", config, 1000)
    assert train(algorithm, bandit(), tmp_path / "again", config, 1000)
    assert_same_run(tmp_path / "whole", tmp_path / "again", name)

    stops = iter([False, False, True])
    assert not train(algorithm, bandit(), tmp_path / "parts", config, 1000, should_stop=lambda: next(stops))
    assert len(logged(tmp_path / "parts")) == 3
    run = RunDirectory.open(tmp_path / "parts")
    run.log({"epoch": 4.0, "total_steps": 800.0})  # as left by a kill between the log and the checkpoint
    run.close()
    reported: list[float] = []
    report = lambda row: reported.append(row["epoch"])  # noqa: E731
    assert train(algorithm, bandit(), tmp_path / "parts", config, 1000, resume=True, report=report)
    assert reported == [4.0, 5.0]
    assert_same_run(tmp_path / "whole", tmp_path / "parts", name)

    assert train(algorithm, bandit(), tmp_path / "other", config, 1000, seed=1)
    assert logged(tmp_path / "other") != logged(tmp_path / "whole")


def test_the_number_of_threads_changes_no_bit(tmp_path: Path) -> None:
    for threads in (1, 3):
        config = cpo.CpoConfig(**SMALL | {"steps_per_epoch": 5000, "threads": threads})
        train(cpo.algorithm, Bandit(100, 50, {"a": 1.0}), tmp_path / str(threads), config, 10_000)
    assert_same_run(tmp_path / "1", tmp_path / "3", "cpo")


def test_resume_before_the_first_checkpoint_starts_again_and_a_finished_run_stays(tmp_path: Path) -> None:
    config = trpo.algorithm.config_type(**SMALL)
    train(trpo.algorithm, bandit(), tmp_path / "whole", config, 400)
    run = RunDirectory.create(tmp_path / "killed", manifest={}, config={})
    run.log({"epoch": 1.0, "total_steps": 200.0})
    run.close()
    assert train(trpo.algorithm, bandit(), tmp_path / "killed", config, 400, resume=True)
    assert_same_run(tmp_path / "whole", tmp_path / "killed", "trpo")
    assert train(trpo.algorithm, bandit(), tmp_path / "killed", config, 400, resume=True)
    assert_same_run(tmp_path / "whole", tmp_path / "killed", "trpo")


def test_an_epoch_is_whole_episodes_of_every_world(tmp_path: Path) -> None:
    T, N = 5, 3
    script = Script(
        np.zeros((T, N)), np.zeros((T, N, 1)), np.zeros((T, N)), np.eye(T)[:, [-1] * N], np.zeros((T, N)), ("a",)
    )
    train(trpo.algorithm, script, tmp_path, OnPolicyConfig(steps_per_epoch=10, hidden=(4,)), 31)
    assert script.starts == [0, 1, 2]  # 15 steps an epoch, rounded up from 10; 31 steps are three epochs
    assert [row["total_steps"] for row in logged(tmp_path)] == [15, 30, 45]


def scripted(rng: np.random.Generator) -> Script:
    """World 0: episodes of 2 (failed), 3 and a cut one of 1 step; world 1: one of 6 steps, truncated."""
    terminated, truncated = np.zeros((6, 2), bool), np.zeros((6, 2), bool)
    terminated[1, 0] = truncated[4, 0] = truncated[5, 1] = True
    reward, success = rng.standard_normal((6, 2)), rng.random((6, 2)) < 0.5
    costs = np.maximum(rng.standard_normal((6, 2, 2)), 0)
    return Script(reward, costs, terminated, truncated, success, ("hazards", "ghosts"))


def test_every_logged_number_of_a_scripted_rollout(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    script = scripted(rng)
    limits = {"ghosts": 0.5, "hazards": 0.0}
    options = {"steps_per_epoch": 12, "hidden": (4,), "value_iterations": 2}
    config = trpo_lagrangian.TrpoLagrangianConfig(**options, cost_limits=limits, multiplier_rate=0.1)
    train(trpo_lagrangian.algorithm, script, tmp_path, config, 24)
    reward, costs, success = script._reward, script._costs, script._success
    episodes = [(slice(0, 2), 0), (slice(2, 5), 0), (slice(0, 6), 1)]
    returns = np.array([reward[e].sum() for e in episodes])
    episode_costs = np.array([costs[e].sum(axis=0) for e in episodes])
    first, second = RunDirectory.open(tmp_path).rows()
    expected = {
        "epoch": 1,
        "total_steps": 12,
        "epoch_steps": 12,
        "episodes": 3,
        "episode_length": (2 + 3 + 6) / 3,
        "return_mean": returns.mean(),
        "return_std": returns.std(),
        "return_min": returns.min(),
        "return_max": returns.max(),
        "cost_mean": episode_costs.sum(axis=1).mean(),
        "cost_hazards": episode_costs[:, 0].mean(),
        "cost_ghosts": episode_costs[:, 1].mean(),
        "success_mean": np.mean([success[e].sum() for e in episodes]),
        "violation_rate": (costs.sum(axis=2) > 0).mean(),
        "cost_rate": costs.sum() / 12,
        "diverged": 1,
        "multiplier_ghosts": 0.1 * max(0, episode_costs[:, 1].mean() - 0.5),
        "multiplier_hazards": 0.1 * episode_costs[:, 0].mean(),
    }
    for name, value in expected.items():
        assert first[name] == pytest.approx(value, rel=1e-12), name
    assert second["cost_rate"] == pytest.approx(costs.sum() / 12)
    assert second["multiplier_hazards"] == pytest.approx(2 * first["multiplier_hazards"])
    update = {"kl", "entropy", "accepted", "line_search_steps", "surrogate_improvement", "reward_advantage_std"}
    losses = {
        f"{v}_loss_{t}" for v in ("value", "cost_value_ghosts", "cost_value_hazards") for t in ("before", "after")
    }
    assert first.keys() == expected.keys() | update | losses | TIMES | {"cg_residual"}
    assert 0 < first["kl"] <= 0.02
    assert first["accepted"] == 1
    assert first["line_search_steps"] >= 1
    assert first["surrogate_improvement"] >= 0
    assert first["steps_per_second"] == pytest.approx(12 / (first["time_rollout"] + first["time_update"]), rel=1e-3)


def test_the_report_is_the_logged_row(tmp_path: Path) -> None:
    rows: list[Any] = []
    train(cpo.algorithm, bandit(), tmp_path, cpo.CpoConfig(**SMALL), 400, report=rows.append)
    assert rows == RunDirectory.open(tmp_path).rows()
    assert {row["feasible"] for row in rows} <= {0.0, 1.0}


def test_a_number_that_is_not_finite_ends_the_training_with_the_last_checkpoint_kept(tmp_path: Path) -> None:
    env = bandit()
    config = trpo.algorithm.config_type(**SMALL)
    train(trpo.algorithm, env, tmp_path, config, 400)
    healthy = env._observe
    env._observe = lambda: np.where(env._steps == 5, np.nan, healthy())
    with pytest.raises(GuardError, match=r"epoch 3: observation is not finite.*checkpoints.000002"):
        train(trpo.algorithm, env, tmp_path, config, 800, resume=True)
    assert len(logged(tmp_path)) == 2
    final_policy(trpo.algorithm, tmp_path)
    env._observe, env._scales = healthy, np.array([np.inf, 1.0])
    with pytest.raises(GuardError, match=r"epoch 1: cost is not finite.*checkpoint is none"):
        train(cpo.algorithm, env, tmp_path / "b", cpo.CpoConfig(**SMALL), 400)
    env._scales = np.array([1e39, 1.0])  # beyond single precision
    with pytest.raises(GuardError, match="epoch 1: gradient of a cost is not finite"):
        train(cpo.algorithm, env, tmp_path / "c", cpo.CpoConfig(**SMALL), 400)


@pytest.mark.parametrize(
    ("config", "total_steps", "message"),
    [
        (cpo.CpoConfig(cost_limits={"hazard": 1.0}), 100, "did you mean hazards"),
        (cpo.CpoConfig(cost_limits={"hazards": -1.0}), 100, "'hazards' = -1.0"),
        (cpo.CpoConfig(cost_limit=-0.1), 100, "'cost' = -0.1"),
        (cpo.CpoConfig(cost_limits={"hazards": float("nan")}), 100, "'hazards' = nan"),
        (cpo.CpoConfig(cost_limit=1.0, cost_limits={"hazards": 1.0}), 100, "set only one"),
        (cpo.CpoConfig(), 0, "total_steps = 0"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(tmp_path: Path, config: Any, total_steps: int, message: str) -> None:
    env = scripted(np.random.default_rng(0))
    with pytest.raises(SpecError, match=message) as caught:
        train(cpo.algorithm, env, tmp_path, config, total_steps)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "options",
    [{"gamma": 1.1}, {"target_kl": 0.0}, {"backtrack_factor": 1.0}, {"hidden": (8, 0)}, {"threads": 0}],
)
def test_options_that_mean_nothing_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(SpecError, match=next(iter(options))):
        OnPolicyConfig(**options)


@pytest.mark.parametrize("module", [cpo, trpo, trpo_fac, trpo_ipo, trpo_lagrangian, trpo_sl, trpo_usl])
def test_no_option_takes_nan(module: Any) -> None:
    config_type = module.algorithm.config_type
    numbers = [f.name for f in dataclasses.fields(config_type) if "float" in str(f.type) and "dict" not in str(f.type)]
    assert "initial_log_std" in numbers
    for name in numbers:
        with pytest.raises(SpecError, match=f"{name} = nan: must be a number"):
            config_type(**{name: np.nan})


@pytest.mark.parametrize("module", [cpo, pcpo])
def test_where_no_cost_occurs_the_step_is_that_of_trpo(tmp_path: Path, module: Any) -> None:
    rows = {}
    for method in (trpo, module):
        env, folder = Bandit(10, 20, {"a": 0.0, "b": 0.0}, 0), tmp_path / method.algorithm.name
        train(method.algorithm, env, folder, method.algorithm.config_type(**SMALL), 1000)
        rows[method] = RunDirectory.open(folder).rows()
    for row, expected in zip(rows[module], rows[trpo], strict=True):
        assert row["line_search_steps"] == expected["line_search_steps"]
        for name in ("surrogate_improvement", "kl", "entropy"):
            assert row[name] == pytest.approx(expected[name], rel=1e-4)


def test_resume_refuses_another_job(tmp_path: Path) -> None:
    train(trpo.algorithm, bandit(), tmp_path, trpo.algorithm.config_type(**SMALL), 200)
    for change, match in (
        ({"config": trpo.algorithm.config_type(**SMALL | {"gamma": 0.5})}, "gamma = 0.99, not 0.5"),
        ({"seed": 3}, "seed = 0, not 3"),
        ({"env": Bandit(5, 20, {"a": 1.0})}, "num_worlds = 10, not 5"),
        ({"algorithm": cpo.algorithm, "config": cpo.CpoConfig(**SMALL)}, "algorithm 'trpo', not 'cpo'"),
    ):
        arguments = {"algorithm": trpo.algorithm, "env": bandit(), "config": trpo.algorithm.config_type(**SMALL)}
        with pytest.raises(RunError, match=match):
            train(**arguments | change, folder=tmp_path, total_steps=400, resume=True)
    longer = trpo.algorithm.config_type(**SMALL | {"checkpoint_every": 7})
    assert train(trpo.algorithm, bandit(), tmp_path, longer, 400, resume=True)


def test_a_policy_acts_as_it_was_trained_and_fits_only_its_own_checkpoint(tmp_path: Path) -> None:
    train(trpo.algorithm, bandit(), tmp_path, trpo.algorithm.config_type(**SMALL), 200)
    checkpoint = RunDirectory.open(tmp_path).last_checkpoint()
    assert checkpoint is not None
    policy = trpo.algorithm.load_policy(checkpoint)
    observation = np.random.default_rng(0).standard_normal((4000, 2))
    mean = policy.act(observation)
    assert mean.shape == (4000, 1) and mean.dtype == np.float64
    np.testing.assert_array_equal(mean, policy.act(observation))
    samples = policy.act(observation, deterministic=False)
    log_std = checkpoints(tmp_path, "trpo")["policy"][-1]
    assert (samples - mean).std() == pytest.approx(np.exp(log_std), rel=0.05)
    assert not np.array_equal(samples, policy.act(observation, deterministic=False))
    again = trpo.algorithm.load_policy(checkpoint)
    np.testing.assert_array_equal(samples, again.act(observation, deterministic=False))
    other = trpo.algorithm.load_policy(checkpoint, seed=1)
    assert not np.array_equal(samples, other.act(observation, deterministic=False))
    with pytest.raises(RunError, match=r"\(4000, 3\).*\(N, 2\)"):
        policy.act(np.zeros((4000, 3)))
    with pytest.raises(RunError, match="algorithm 'trpo', not 'cpo'"):
        cpo.algorithm.load_policy(checkpoint)
    with pytest.raises(RunError, match="no such checkpoint"):
        trpo.algorithm.load_policy(tmp_path / "nowhere")


def test_a_checkpoint_of_another_shape_is_refused(tmp_path: Path) -> None:
    train(trpo.algorithm, bandit(), tmp_path, trpo.algorithm.config_type(**SMALL), 200)
    run = RunDirectory.open(tmp_path)
    checkpoint = run.last_checkpoint()
    assert checkpoint is not None
    from guard_api.runs.checkpoint import load_checkpoint

    arrays, state = load_checkpoint(checkpoint)
    shorter = run.save_checkpoint(2, {**arrays, "policy": arrays["policy"][:-1]}, state)
    with pytest.raises(RunError, match=r"'policy' is \(\d+,\), expected"):
        trpo.algorithm.load_policy(shorter)
    incomplete = run.save_checkpoint(3, arrays, {key: state[key] for key in ("algorithm", "epoch")})
    with pytest.raises(RunError, match="not that of a training"):
        trpo.algorithm.load_policy(incomplete)
