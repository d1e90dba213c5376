"""Every number of an update's row in the log is what its name says: recomputed from the batch and the policies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from guard_algos import cpo, pcpo, trpo, trpo_fac, trpo_ipo, trpo_lagrangian, trpo_sl, trpo_usl
from tests.algos.corridor import LENGTH, Corridor
from tests.algos.recording import Epoch, record
from tests.algos.reference import Gaussian, network, to_go

MODULES = (trpo, trpo_lagrangian, trpo_fac, trpo_ipo, cpo, pcpo, trpo_sl, trpo_usl)
ALGORITHMS = {module.algorithm.name: module.algorithm for module in MODULES}
OWN: dict[str, dict[str, Any]] = {
    "trpo-lagrangian": {"cost_limit": 1.5, "multiplier_rate": 0.5},
    "trpo-fac": {"cost_limit": 1.5, "multiplier_learning_rate": 0.1},
    "trpo-ipo": {"cost_limit": 0.5},
    "cpo": {"cost_limit": 0.2},
    "pcpo": {"cost_limit": 0.2},
}
WIDTH, WORLDS, EPOCHS, TRIALS, SHRINK = 4, 10, 9, 4, 0.9
POLICY, CRITIC = (2, WIDTH, 2), (2, WIDTH, 1)
SHARED: dict[str, Any] = {
    "steps_per_epoch": LENGTH * WORLDS,
    "hidden": (WIDTH,),
    "gamma": 0.9,
    "gae_lambda": 0.8,
    "target_kl": 0.1,  # steps so large that KL(old || new) and KL(new || old) are two numbers
    "backtrack_factor": SHRINK,
    "backtrack_steps": TRIALS,  # so few that some searches fail
    "cg_iterations": 4,  # so few that the residual is not rounding
    "cg_tolerance": 1e-6,
    "cg_damping": 0.01,
    "value_iterations": 5,
    "value_learning_rate": 0.01,
    "checkpoint_every": 1,
    "threads": 1,
}


@dataclass(frozen=True)
class Check:
    """An epoch and what its row is checked against, all in float64."""

    name: str
    config: Any
    epoch: Epoch

    @property
    def row(self) -> dict[str, float]:
        return self.epoch.row

    @cached_property
    def observation(self) -> np.ndarray:
        return self.epoch.batch.rollout.observation.double().numpy().reshape(-1, 2)

    @cached_property
    def action(self) -> np.ndarray:
        return self.epoch.batch.rollout.action.double().numpy().reshape(-1, 2)

    @cached_property
    def old(self) -> Gaussian:
        return Gaussian(self.epoch.before["policy"], POLICY)

    @cached_property
    def new(self) -> Gaussian:
        return Gaussian(self.epoch.after["policy"], POLICY)

    @cached_property
    def margin(self) -> float:
        """How far the mean episode cost is above the limit, per step."""
        costs = self.epoch.batch.rollout.costs.sum(axis=(0, 2))
        return float(costs.mean() - self.config.cost_limit) / LENGTH

    def estimate(self, critic: str, signal: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the advantages and values (T, N) of `signal` under a critic as it was before the epoch's fit."""
        rollout, parameters = self.epoch.batch.rollout, self.epoch.before[f"critic.{critic}.parameters"]
        value = network(parameters.astype(float), CRITIC, self.observation).reshape(LENGTH, WORLDS)
        last = network(parameters.astype(float), CRITIC, rollout.last_observation.double().numpy())
        after = np.concatenate([value[1:], last.T])  # every episode ends with the rollout, at its time limit
        return to_go(signal, value, after, rollout.ended, 0.9, weight), value

    @cached_property
    def raw_advantage(self) -> np.ndarray:
        return self.estimate("value", self.epoch.batch.rollout.reward, 0.8)[0].ravel()

    @cached_property
    def advantage(self) -> np.ndarray:
        return (self.raw_advantage - self.raw_advantage.mean()) / self.raw_advantage.std()

    @cached_property
    def cost_advantage(self) -> np.ndarray:
        costs = self.epoch.batch.rollout.costs.sum(axis=2)
        raw = self.estimate("cost_value_cost", costs, 0.8)[0].ravel()
        return (raw - raw.mean()) * costs.any()  # of a cost that did not occur, nothing is estimated

    def ratio(self, policy: Gaussian) -> np.ndarray:
        log_probs = [one.log_prob(self.observation, self.action) for one in (policy, self.old)]
        return np.exp(log_probs[0] - log_probs[1])

    def improvement(self, policy: Gaussian) -> float:
        """Return how much better the objective of the algorithm finds `policy` than the old one."""
        change = self.ratio(policy) - 1
        if self.name == "trpo-lagrangian":
            multiplier = self.epoch.before["method.multipliers"][0]
            return float((change * (self.advantage - multiplier * self.cost_advantage)).mean() / (1 + multiplier))
        if self.name == "trpo-fac":
            parameters = self.epoch.before["method.multiplier.parameters"].astype(float)
            multiplier = np.log1p(np.exp(network(parameters, CRITIC, self.observation)[:, 0]))
            return float((change * (self.advantage - multiplier * self.cost_advantage)).mean())
        if self.name == "trpo-ipo":
            if self.margin >= 0:
                return -self.cost_change(policy)
            room = (self.cost_change(policy) + self.margin) / self.margin
            barrier = np.log(room) / (self.config.barrier_t * LENGTH * self.raw_advantage.std()) if room > 0 else np.nan
            return float((change * self.advantage).mean() + barrier)
        return float((change * self.advantage).mean())

    def cost_change(self, policy: Gaussian) -> float:
        return float(((self.ratio(policy) - 1) * self.cost_advantage).mean())

    def accepts(self, policy: Gaussian, slack: float) -> bool:
        """Return whether the line search stops at `policy`, by a rule that is looser by `slack` than the algorithm's.

        The whole step is made to have the KL of the radius, so single precision may decide.
        """
        if not self.old.kl(policy, self.observation) <= self.config.target_kl * (1 + slack):
            return False
        if self.name not in ("cpo", "pcpo"):
            return self.improvement(policy) >= -slack
        exceeded, change = self.margin > 0, self.cost_change(policy)
        if self.row["feasible"]:
            return change <= max(-self.margin, 0) + slack and (exceeded or self.improvement(policy) >= -slack)
        return max(self.margin + change, 0) <= max(self.margin, 0) + slack


class Recordings:
    """One short training of each algorithm, when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._checks = folder, dict[str, list[Check]]()

    def __call__(self, name: str, **options: Any) -> list[Check]:
        """Return the checks of all epochs of an algorithm's training; `options` make another one."""
        key = f"{name} {options}"
        if key not in self._checks:
            algorithm = ALGORITHMS[name]
            config = algorithm.config_type(**SHARED | OWN.get(name, {}) | options)
            folder = self._folder / str(len(self._checks))
            epochs = record(algorithm, Corridor(WORLDS, line=0.5), folder, config, EPOCHS * LENGTH * WORLDS)
            self._checks[key] = [Check(name, config, epoch) for epoch in epochs]
        return self._checks[key]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Recordings:
    return Recordings(tmp_path_factory.mktemp("recordings"))


@pytest.fixture(params=ALGORITHMS)
def checks(request: pytest.FixtureRequest, recordings: Recordings) -> list[Check]:
    return recordings(request.param)


def test_kl_is_that_of_the_kept_policy_from_the_old_one(checks: list[Check]) -> None:
    for check in checks:
        assert check.row["kl"] == pytest.approx(check.old.kl(check.new, check.observation), rel=1e-4, abs=1e-9)
    kept = [check for check in checks if check.row["accepted"]]
    reverse = [check.new.kl(check.old, check.observation) / check.row["kl"] for check in kept]
    assert max(np.abs(np.log(reverse))) > 0.02  # the other direction would not have passed


def test_entropy_is_that_of_the_new_policy(checks: list[Check]) -> None:
    for check in checks:
        assert check.row["entropy"] == pytest.approx(check.new.entropy(), rel=1e-6)
    assert any(abs(check.old.entropy() - check.new.entropy()) > 1e-2 for check in checks)


def test_improvement_is_the_change_of_the_objective_by_the_kept_policy(checks: list[Check]) -> None:
    for check in checks:
        expected = check.improvement(check.new)
        assert check.row["surrogate_improvement"] == pytest.approx(expected, rel=1e-3, abs=1e-6)
    assert max(abs(check.row["surrogate_improvement"]) for check in checks) > 0.05


def assert_search(check: Check) -> None:
    """The logged number of trials is where the search must stop, and the kept policy is that trial or the old one."""
    most = check.config.backtrack_steps
    trials = [check.old.moved(SHRINK**j * check.epoch.step) for j in range(most)]
    count, accepted = int(check.row["line_search_steps"]), check.row["accepted"] == 1
    assert not any(check.accepts(trial, -1e-4) for trial in trials[: count - accepted])
    assert check.accepts(trials[count - 1], 1e-4) if accepted else count == most
    kept = trials[count - 1] if accepted else check.old
    np.testing.assert_allclose(check.new.theta, kept.theta, atol=1e-6)


def test_line_search_steps_are_the_trials_up_to_the_first_that_is_acceptable(checks: list[Check]) -> None:
    for check in checks:
        assert_search(check)
    assert len({check.row["line_search_steps"] for check in checks}) > 1


def test_a_search_that_fails_keeps_the_policy_and_counts_all_trials(recordings: Recordings) -> None:
    checks = recordings("trpo", backtrack_steps=1)
    failed = [check for check in checks if not check.row["accepted"]]
    assert 0 < len(failed) < len(checks)
    for check in checks:
        assert_search(check)
    for check in failed:
        assert (check.row["kl"], check.row["surrogate_improvement"]) == (0, 0)


def residuals(check: Check) -> list[float]:
    """Return the relative residual of each linear system of the update, by its matrix written out."""
    A = check.old.fisher(check.observation) + 0.01 * np.eye(len(check.old.theta))
    return [float(np.linalg.norm(A @ x - b) / max(np.linalg.norm(b), 1e-300)) for b, x in check.epoch.solves]


def test_residual_is_that_of_the_linear_system(checks: list[Check]) -> None:
    for check in checks:
        assert len(residuals(check)) == (2 if check.name in ("cpo", "pcpo") else 1)
        assert check.row["cg_residual"] == pytest.approx(max(residuals(check)), rel=1e-3)


def test_residual_of_several_systems_is_the_largest(recordings: Recordings) -> None:
    largest = set()
    for check in recordings("cpo", cost_limit=0.0, cost_limits={"line": 0.2, "spare": 1.0}):
        largest.add(int(np.argmax(residuals(check))))
        assert check.row["cg_residual"] == pytest.approx(max(residuals(check)), rel=1e-3)
    assert largest - {0} and largest - {2}  # neither the first nor the last alone would have passed


def test_losses_are_the_critics_mean_squared_errors_before_and_after_the_fit(checks: list[Check]) -> None:
    for check in checks:
        rollout = check.epoch.batch.rollout
        signals = {"value": rollout.reward}
        if check.name in OWN:
            signals["cost_value_cost"] = rollout.costs.sum(axis=2)
        for critic, signal in signals.items():
            advantage, value = check.estimate(critic, signal, 1.0)
            target = (advantage + value).ravel()
            for when, arrays in (("before", check.epoch.before), ("after", check.epoch.after)):
                parameters = arrays[f"critic.{critic}.parameters"].astype(float)
                error = network(parameters, CRITIC, check.observation)[:, 0] - target
                assert check.row[f"{critic}_loss_{when}"] == pytest.approx((error**2).mean(), rel=1e-4)


def test_spread_of_the_advantages_is_that_before_it_was_scaled_away(checks: list[Check]) -> None:
    for check in checks:
        assert check.row["reward_advantage_std"] == pytest.approx(check.raw_advantage.std(), rel=1e-5)


def test_multiplier_climbs_by_its_rate_times_the_excess_of_the_episode_cost_and_falls_below_the_limit(
    recordings: Recordings,
) -> None:
    checks = recordings("trpo-lagrangian")
    before = np.array([check.epoch.before["method.multipliers"][0] for check in checks])
    excess = np.array([check.margin * LENGTH for check in checks])
    logged = np.array([check.row["multiplier_cost"] for check in checks])
    np.testing.assert_allclose(logged, np.maximum(before + 0.5 * excess, 0))
    np.testing.assert_allclose(logged[:-1], before[1:])
    assert excess.min() < 0 < excess.max()


@pytest.mark.parametrize(("name", "options"), [("cpo", {"target_kl": 0.002, "cost_limit": 2.0}), ("trpo-ipo", {})])
def test_feasible_is_whether_a_step_in_the_trust_region_can_keep_the_limit(
    recordings: Recordings, name: str, options: dict[str, Any]
) -> None:
    """For IPO: whether the limit is kept now, which its barrier needs."""
    checks = recordings(name, **options)
    for check in checks:
        b, inverse_b = check.epoch.solves[-1]
        reach = np.sqrt(2 * check.config.target_kl * (b @ inverse_b)) if name == "cpo" else 0.0
        assert check.row["feasible"] == (check.margin <= reach)
    assert {check.row["feasible"] for check in checks} == {0.0, 1.0}
