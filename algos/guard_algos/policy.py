"""A trained policy, loaded from a checkpoint: numpy in, numpy out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos.checkpoint import POLICY, TrainingState, check_shapes
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_algos.rollout import Correct
from guard_api.errors import RunError


class TrainedPolicy:
    """A policy that acts as it did in training, with the same correction; samples come from its own generator."""

    def __init__(self, policy: GaussianPolicy, theta: Tensor, seed: int, correct: Correct | None = None) -> None:
        self._policy, self._theta, self._correct = policy, theta, correct
        self._generator = torch.Generator().manual_seed(seed)

    def mean(self, observation: Tensor) -> Tensor:
        """Return the mean actions (N, A) at observations (N, O) before any correction."""
        return self._policy.mean(self._theta, observation)

    def act(
        self,
        observation: NDArray[np.floating],
        deterministic: bool = True,
        costs: NDArray[np.floating] | None = None,
    ) -> NDArray[np.float64]:
        """Return actions (N, A) for observations (N, O): the mean, or a sample when not deterministic, corrected.

        costs: (N, C) of the step before, 0 at an episode's start; only a safety layer looks at them. An action that is
        not corrected is not clipped. Raises RunError for observations of another size than the policy was trained with.
        """
        size = self._policy.network.sizes[0]
        if observation.ndim != 2 or observation.shape[1] != size:
            raise RunError(f"observation of shape {observation.shape}: this policy was trained with (N, {size})")
        x = torch.from_numpy(np.ascontiguousarray(observation, np.float32))
        with torch.no_grad():
            if deterministic:
                action = self.mean(x)
            else:
                noise = torch.randn(len(x), self._policy.action_size, generator=self._generator)
                action = self._policy.act(self._theta, x, noise)
            if self._correct is not None:
                before = None if costs is None else torch.from_numpy(np.asarray(costs, np.float64))
                action = self._correct(x, before, action)
        return action.double().numpy()


def make_policy(
    path: Path, arrays: Mapping[str, NDArray[Any]], state: TrainingState, seed: int, correct: Correct | None
) -> TrainedPolicy:
    """Return the policy whose checkpoint `path` holds `arrays` and `state`. Raises RunError where they do not fit."""
    if len(state.policy_sizes) < 2 or min(state.policy_sizes) < 1:
        raise RunError(f"{path}: policy_sizes = {list(state.policy_sizes)} is no network: use another checkpoint")
    policy = GaussianPolicy(Mlp(state.policy_sizes))
    length = policy.network.num_parameters + policy.action_size
    check_shapes(path, arrays, {POLICY: (length,)})
    theta = torch.from_numpy(np.array(arrays[POLICY], np.float32))
    if not bool(torch.isfinite(theta).all()):
        raise RunError(f"{path}: the policy's parameters are not finite: use an earlier checkpoint")
    return TrainedPolicy(policy, theta, seed, correct)
