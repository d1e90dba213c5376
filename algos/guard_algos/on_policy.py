"""The training loop of every on-policy algorithm: collect whole episodes, improve the policy, fit the critics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos import checkpoint as checkpoints
from guard_algos import constraints
from guard_algos.batch import Batch, make_batch
from guard_algos.best import Standing, standing
from guard_algos.checkpoint import TrainingState
from guard_algos.config import CostLimits, OnPolicyConfig, paper
from guard_algos.constraints import Constraint
from guard_algos.critics import Critic
from guard_algos.finite import NotFiniteError
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_algos.policy import TrainedPolicy, make_policy
from guard_algos.rollout import Correct, collect
from guard_algos.workers import workers
from guard_api.algorithm import Preset, TrainingJob, whole_episodes
from guard_api.errors import GuardError, SpecError


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What a method may know of the environment and the training.

    cost_names: the environment's costs. constraints: those of the config. total_steps: of the training.
    generator: for the initial parameters of a method's own networks.
    """

    observation_size: int
    action_size: int
    cost_names: tuple[str, ...]
    constraints: tuple[Constraint, ...]
    total_steps: int
    generator: torch.Generator


class Method:
    """What one algorithm adds to the loop: how a batch improves the policy, and what is executed of its actions."""

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Move the policy's parameters theta (P,) in place; return the method's columns of the log."""
        raise NotImplementedError

    def correct(self, observation: Tensor, costs: Tensor | None, action: Tensor) -> Tensor:
        """Return what is executed of the policy's actions: see `rollout.Correct`."""
        return action

    def traceable(self) -> Correct | None:
        """Return `correct` as tensor operations without control flow on values; None where it changes nothing."""
        return None

    def tensors(self) -> dict[str, Tensor]:
        """Return the live state that the method learns; a checkpoint saves it and writes it back in place."""
        return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class OnPolicyAlgorithm:
    """An algorithm plugin: its name, its options and its method, on the shared loop.

    corrects: whether the method corrects actions, which its trained policies then need too.
    """

    name: str
    config_type: type[OnPolicyConfig]
    method: Callable[[Any, Problem], Method]
    corrects: bool = False

    @property
    def presets(self) -> Mapping[str, Preset]:
        """The settings that have a name."""
        return {"paper": paper(self.config_type)}

    def train(self, job: TrainingJob) -> bool:
        """Train until `job.total_steps`; return whether they were reached.

        Raises SpecError for options that do not fit the environment, RunError for a checkpoint that cannot be resumed,
        and GuardError naming epoch and quantity for a number that is not finite (earlier checkpoints stay).
        """
        if job.total_steps < 1:
            raise SpecError(f"total_steps = {job.total_steps}: must be at least 1")
        with workers(job.config.threads) as pool, torch.no_grad():
            training = _Training(self, job, pool)
            if job.resume:
                training.resume()
            return training.run()

    def load_policy(self, checkpoint: Path, seed: int = 0) -> TrainedPolicy:
        """Load the policy of one checkpoint; `seed` is that of its samples. Raises RunError when it is not usable."""
        arrays, state = checkpoints.read(checkpoint, self.name)
        correct = self._trained_method(checkpoint, arrays, state).correct if self.corrects else None
        return make_policy(checkpoint, arrays, state, seed, correct)

    def export_policy(self, checkpoint: Path, out: Path, contract: Mapping[str, Any]) -> dict[str, Any]:
        """Write the policy of one checkpoint to `out` as ONNX, with `contract`: see `onnx_export.write`."""
        from guard_algos import onnx_export  # noqa: PLC0415  needs packages that training does not

        arrays, state = checkpoints.read(checkpoint, self.name)
        policy = self.load_policy(checkpoint)
        correct = self._trained_method(checkpoint, arrays, state).traceable() if self.corrects else None
        return onnx_export.write(policy, correct, state, out, contract)

    def _trained_method(self, path: Path, arrays: Mapping[str, NDArray[Any]], state: TrainingState) -> Method:
        """Return the method as the checkpoint left it."""
        config = checkpoints.read_config(path, state, self.config_type)
        problem = Problem(
            observation_size=state.policy_sizes[0],
            action_size=state.policy_sizes[-1],
            cost_names=state.cost_names,
            constraints=_constraints(config, state.cost_names),
            total_steps=state.total_steps,
            generator=torch.Generator(),
        )
        method = self.method(config, problem)
        checkpoints.fill(path, arrays, _nested("method", method.tensors()))
        return method


class _Training:
    """One training's whole state between two epochs, and the epoch.

    An epoch is `rounds` episodes of every world, the fewest that hold `steps_per_epoch` steps, so no simulator state
    crosses from one epoch to the next and every checkpoint falls between episodes. Where a world fails within one, it
    goes on with its next episode; the one that the end of the epoch cuts is learned from, but not counted.
    """

    def __init__(self, algorithm: OnPolicyAlgorithm, job: TrainingJob, pool: Executor) -> None:
        env = job.env
        config: OnPolicyConfig = job.config
        self._algorithm, self._job, self._config, self._pool = algorithm, job, config, pool
        self._epoch_steps = whole_episodes(config.steps_per_epoch, env.num_worlds, env.episode_length)
        self._rounds = self._epoch_steps // (env.num_worlds * env.episode_length)
        # Samples have a generator of their own, so that they do not depend on how many networks an algorithm has.
        initial, self._generator = (torch.Generator().manual_seed(seed) for seed in _seeds(job.seed))
        sizes = (env.observation_size, *config.hidden)
        self._policy = GaussianPolicy(Mlp((*sizes, env.action_size)))
        self._theta = self._policy.init(initial, config.initial_log_std)
        self._constraints = _constraints(config, env.cost_names)
        names = ["value", *(f"cost_value_{constraint.name}" for constraint in self._constraints)]
        self._critics = {name: Critic(Mlp((*sizes, 1)), initial, config.value_learning_rate) for name in names}
        self._method = algorithm.method(
            config,
            Problem(
                observation_size=env.observation_size,
                action_size=env.action_size,
                cost_names=tuple(env.cost_names),
                constraints=self._constraints,
                total_steps=job.total_steps,
                generator=initial,
            ),
        )
        self._epoch, self._total_steps, self._cumulative_cost = 0, 0, 0.0
        self._best: Standing | None = None

    def run(self) -> bool:
        """Train epoch by epoch; return whether the job's steps were reached."""
        epochs = math.ceil(self._job.total_steps / self._epoch_steps)
        while self._epoch < epochs:
            try:
                row = self._train_epoch()
            except NotFiniteError as error:
                raise GuardError(
                    f"training stopped in epoch {self._epoch + 1}: {error}; the last good checkpoint is "
                    f"{self._job.run.last_checkpoint() or 'none'}: check the environment, or lower value_learning_rate"
                ) from error
            self._job.run.log(row)
            self._job.report(row)
            stop = self._job.should_stop()
            if stop or self._epoch == epochs or self._epoch % self._config.checkpoint_every == 0:
                self._save()
            if stop:
                return self._epoch == epochs
        return True

    def _train_epoch(self) -> dict[str, float]:
        begin = perf_counter()
        rollout = collect(
            self._job.env,
            self._act,
            episode=self._epoch * self._rounds,
            num_steps=self._rounds * self._job.env.episode_length,
            generator=self._generator,
            correct=self._method.correct,
        )
        collected = perf_counter()
        batch = make_batch(
            rollout,
            self._policy,
            self._theta,
            list(self._critics.values()),
            self._constraints,
            self._config,
            self._pool,
        )
        acting = {name: tensor.clone() for name, tensor in self._acting().items()}
        learned = self._method.improve(self._policy, self._theta, batch, self._pool) | self._fit_critics(batch)
        done = perf_counter()
        self._epoch += 1
        self._total_steps += self._epoch_steps
        self._cumulative_cost += float(rollout.costs.sum())
        self._keep_best(standing(batch.episodes, self._constraints), acting)
        times = {"time_rollout": collected - begin, "time_update": done - collected}
        return self._row(batch) | learned | times | {"steps_per_second": self._epoch_steps / (done - begin)}

    def _row(self, batch: Batch) -> dict[str, float]:
        """Return the columns of the log that every algorithm has, of the epoch that just ended."""
        return {
            "epoch": float(self._epoch),
            "total_steps": float(self._total_steps),
            "epoch_steps": float(self._epoch_steps),
            **batch.episodes.row(self._job.env.cost_names),
            "violation_rate": float((batch.rollout.costs > 0).any(axis=-1).mean()),
            "cost_rate": self._cumulative_cost / self._total_steps,
            "diverged": float(batch.rollout.diverged),
            "entropy": self._policy.entropy(self._theta),
            "reward_advantage_std": batch.reward_advantage_std,
        }

    def _act(self, observation: Tensor, noise: Tensor) -> Tensor:
        return self._policy.act(self._theta, observation, noise)

    def _fit_critics(self, batch: Batch) -> dict[str, float]:
        row, steps, size = {}, self._config.value_iterations, self._config.value_batch_size
        for (name, critic), target in zip(self._critics.items(), batch.targets.T.contiguous(), strict=True):
            before, after = critic.fit(batch.observation, target, steps, size, self._pool)
            row |= {f"{name}_loss_before": before, f"{name}_loss_after": after}
        return row

    def _keep_best(self, now: Standing, acting: Mapping[str, Tensor]) -> None:
        """Save the policy that acted in the epoch that just ended, if it is the best so far."""
        if self._best is None or now > self._best:
            self._best = now
            arrays = {name: tensor.numpy() for name, tensor in acting.items()}
            self._job.run.save_best(arrays, self._state().to_json())

    def _save(self) -> None:
        tensors = checkpoints.to_arrays(self._tensors(), self._generator)
        self._job.run.save_checkpoint(self._epoch, tensors, self._state().to_json())

    def _state(self) -> TrainingState:
        return TrainingState(
            algorithm=self._algorithm.name,
            policy_sizes=self._policy.network.sizes,
            job=checkpoints.identity(self._job),
            epoch=self._epoch,
            total_steps=self._total_steps,
            cumulative_cost=self._cumulative_cost,
            cost_names=tuple(self._job.env.cost_names),
            best=None if self._best is None else (self._best.within, self._best.merit),
        )

    def resume(self) -> None:
        """Go back to the last checkpoint, or to the start where the run was stopped before its first one."""
        path = self._job.run.last_checkpoint()
        if path is not None:
            state = checkpoints.restore(path, self._algorithm.name, self._job, self._tensors(), self._generator)
            self._epoch, self._total_steps = state.epoch, state.total_steps
            self._cumulative_cost = state.cumulative_cost
            self._best = None if state.best is None else Standing(*state.best)
        self._job.run.truncate_log(self._epoch)

    def _acting(self) -> dict[str, Tensor]:
        """Return everything live that decides the actions."""
        return {checkpoints.POLICY: self._theta} | _nested("method", self._method.tensors())

    def _tensors(self) -> dict[str, Tensor]:
        """Return everything that is learned, live."""
        tensors = self._acting()
        for name, critic in self._critics.items():
            tensors |= _nested(f"critic.{name}", critic.tensors())
        return tensors


def _nested(part: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {f"{part}.{key}": tensor for key, tensor in tensors.items()}


def _constraints(config: OnPolicyConfig, cost_names: Sequence[str]) -> tuple[Constraint, ...]:
    return constraints.resolve(config, cost_names) if isinstance(config, CostLimits) else ()


def _seeds(seed: int) -> list[int]:
    """Return two independent seeds made of one."""
    return [int(word) for word in np.random.SeedSequence(seed).generate_state(2)]
