"""Evaluating a policy: an exact number of episodes whose starts are the same on every backend."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from guard_api.algorithm import Policy
from guard_api.env import FAILURE_COST
from guard_api.errors import RunError

if TYPE_CHECKING:
    from guard_api.env import Environment

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeTable:
    """What E episodes gave; row e is the episode that world `e % num_worlds` played as its number `e // num_worlds`.

    Layout, goals and start of row e come from the stream (seed, e % num_worlds, e // num_worlds) alone, so rows of two
    tables with equal `seed` and `num_worlds` are pairs, whatever the backend or the policy.

    A failed episode (diverged physics, an action that is not finite) is an outcome, never dropped: it keeps the return
    scored until then and is charged `FAILURE_COST` in every column, and a violation, for each step that it missed.

    cost_names: the C columns of `costs`. returns: (E,) summed reward. costs: (E, C) summed cost.
    violation: (E,) share of the steps with any cost above zero. goals: (E,) goals achieved.
    length: (E,) steps played. failed: (E,). failures: row -> reason.
    """

    seed: int
    num_worlds: int
    cost_names: tuple[str, ...]
    returns: Array
    costs: Array
    violation: Array
    goals: NDArray[np.int64]
    length: NDArray[np.int64]
    failed: NDArray[np.bool_]
    failures: Mapping[int, str]

    @property
    def episodes(self) -> int:
        """Number of episodes E."""
        return len(self.returns)

    @property
    def cost(self) -> Array:
        """Cost summed over the constraints: (E,)."""
        return self.costs.sum(axis=1)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Whether at least one goal was achieved in an episode that did not fail: (E,)."""
        return (self.goals > 0) & ~self.failed

    def to_json(self) -> dict[str, Any]:
        """Return the table as JSON data; `from_json` reads it back bit for bit."""
        return {
            "seed": self.seed,
            "num_worlds": self.num_worlds,
            "cost_names": list(self.cost_names),
            "returns": self.returns.tolist(),
            "costs": self.costs.tolist(),
            "violation": self.violation.tolist(),
            "goals": self.goals.tolist(),
            "length": self.length.tolist(),
            "failures": {str(row): reason for row, reason in self.failures.items()},
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> EpisodeTable:
        """Read a table written by `to_json`. Raises RunError when a field is missing or malformed."""
        try:
            returns = np.asarray(data["returns"], dtype=np.float64)
            names = tuple(data["cost_names"])
            failures = {int(row): str(reason) for row, reason in data["failures"].items()}
            failed = np.zeros(len(returns), dtype=bool)
            failed[list(failures)] = True
            return cls(
                seed=data["seed"],
                num_worlds=data["num_worlds"],
                cost_names=names,
                returns=returns,
                costs=np.asarray(data["costs"], dtype=np.float64).reshape(len(returns), len(names)),
                violation=np.asarray(data["violation"], dtype=np.float64),
                goals=np.asarray(data["goals"], dtype=np.int64),
                length=np.asarray(data["length"], dtype=np.int64),
                failed=failed,
                failures=failures,
            )
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise RunError(
                f"episode table: missing or malformed field ({error}): delete the file and measure again"
            ) from error


class RandomPolicy:
    """Uniform actions in [-1, 1]: the reference below which a return is worth nothing."""

    def __init__(self, action_size: int, seed: int) -> None:
        self._action_size = action_size
        self._generator = np.random.default_rng(seed)

    def act(
        self,
        observation: NDArray[np.floating],
        deterministic: bool = True,
        costs: NDArray[np.floating] | None = None,
    ) -> Array:
        """Return actions (N, A) for observations (N, O); random whatever `deterministic` and `costs` say."""
        return self._generator.uniform(-1.0, 1.0, (len(observation), self._action_size))


def evaluate(
    policy: Policy, env: Environment, episodes: int, deterministic: bool = True, seed: int | None = None
) -> EpisodeTable:
    """Play exactly `episodes` episodes, from episode number 0 of every world, and return them.

    seed: replaces the environment's seed. Each world plays a number of episodes fixed beforehand, so short episodes
    are not over-represented. Raises ValueError for `episodes` < 1.
    """
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}: it must be at least 1")
    observation = env.reset(episode=0, seed=env.seed if seed is None else seed)
    costs = np.zeros((env.num_worlds, len(env.cost_names)))
    tally = _Tally(env.num_worlds, len(env.cost_names), episodes)
    while not tally.complete:
        action = np.asarray(policy.act(observation, deterministic, costs), dtype=np.float64)
        invalid = np.any(~np.isfinite(action), axis=1)
        step = env.step(np.where(invalid[:, None], 0.0, action))
        ended = step.terminated | step.truncated
        observation, costs = step.observation, np.where(ended[:, None], 0.0, step.costs)
        tally.fail(dict.fromkeys(np.flatnonzero(invalid).tolist(), "the policy's action was not finite"))
        tally.add(step.reward, step.costs, step.success)
        tally.fail(step.failures)
        tally.end(ended, env.episode_length)
    return tally.table(env.seed, env.cost_names)


class _Tally:
    """Running sums of N worlds' present episodes, and the rows of those that ended."""

    def __init__(self, num_worlds: int, num_costs: int, episodes: int) -> None:
        self._num_worlds, self._episodes = num_worlds, episodes
        self._round = np.zeros(num_worlds, dtype=np.int64)
        self._alive = np.ones(num_worlds, dtype=bool)
        self._reasons: dict[int, str] = {}
        self._now = _rows(num_worlds, num_costs)
        self._done = _rows(episodes, num_costs)
        self._failures: dict[int, str] = {}

    @property
    def complete(self) -> bool:
        """Whether every row has been played."""
        return bool((self._row() >= self._episodes).all())

    def add(self, reward: Array, costs: Array, success: NDArray[np.bool_]) -> None:
        """Add one step of every world whose episode has not failed."""
        invalid = ~(np.isfinite(reward) & np.isfinite(costs).all(axis=1))
        self.fail(dict.fromkeys(np.flatnonzero(invalid).tolist(), "reward or cost was not finite"))
        alive = self._alive
        self._now["returns"][alive] += reward[alive]
        self._now["costs"][alive] += costs[alive]
        self._now["violation"][alive] += (costs[alive] > 0.0).any(axis=1)
        self._now["goals"][alive] += success[alive]
        self._now["length"][alive] += 1

    def fail(self, reasons: Mapping[int, str]) -> None:
        """Close the present episodes of these worlds for further steps, for the first reason given."""
        for world, reason in reasons.items():
            self._reasons.setdefault(world, reason)
            self._alive[world] = False

    def end(self, ended: NDArray[np.bool_], episode_length: int) -> None:
        """Write the rows of the worlds whose episode ended, and begin their next one."""
        if not ended.any():
            return
        missed = np.where(self._alive, 0, episode_length - self._now["length"])
        self._now["costs"] += FAILURE_COST * missed[:, None]
        self._now["violation"] = (self._now["violation"] + missed) / np.maximum(self._now["length"] + missed, 1)
        row = self._row()
        kept = ended & (row < self._episodes)
        for name, values in self._now.items():
            self._done[name][row[kept]] = values[kept]
        for world in np.flatnonzero(kept & ~self._alive).tolist():
            self._failures[int(row[world])] = self._reasons[world]
        self._clear(ended)

    def _clear(self, ended: NDArray[np.bool_]) -> None:
        for values in self._now.values():
            values[ended] = 0
        self._round[ended] += 1
        self._alive[ended] = True
        self._reasons = {world: reason for world, reason in self._reasons.items() if not ended[world]}

    def table(self, seed: int, cost_names: tuple[str, ...]) -> EpisodeTable:
        """Return the finished rows."""
        failed = np.zeros(self._episodes, dtype=bool)
        failed[list(self._failures)] = True
        return EpisodeTable(
            seed=seed,
            num_worlds=self._num_worlds,
            cost_names=cost_names,
            returns=self._done["returns"],
            costs=self._done["costs"],
            violation=self._done["violation"],
            goals=self._done["goals"].astype(np.int64),
            length=self._done["length"].astype(np.int64),
            failed=failed,
            failures=dict(sorted(self._failures.items())),
        )

    def _row(self) -> NDArray[np.int64]:
        return self._round * self._num_worlds + np.arange(self._num_worlds)


def _rows(count: int, num_costs: int) -> dict[str, Array]:
    rows = {name: np.zeros(count) for name in ("returns", "violation", "goals", "length")}
    return {**rows, "costs": np.zeros((count, num_costs))}
