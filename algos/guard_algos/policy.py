"""A trained policy, loaded from a checkpoint: numpy in, numpy out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos import checkpoint
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import Mlp
from guard_api.errors import RunError


class TrainedPolicy:
    """A policy that acts; samples come from its own generator."""

    def __init__(self, policy: GaussianPolicy, theta: Tensor, seed: int) -> None:
        self._policy, self._theta = policy, theta
        self._generator = torch.Generator().manual_seed(seed)

    def act(self, observation: NDArray[np.floating], deterministic: bool = True) -> NDArray[np.float64]:
        """Return actions (N, A) for observations (N, O): the mean, or a sample when not deterministic; never clipped.

        Raises RunError for observations of another size than the policy was trained with.
        """
        size = self._policy.network.sizes[0]
        if observation.ndim != 2 or observation.shape[1] != size:
            raise RunError(f"observation of shape {observation.shape}: this policy was trained with (N, {size})")
        x = torch.from_numpy(np.ascontiguousarray(observation, np.float32))
        with torch.no_grad():
            if deterministic:
                action = self._policy.mean(self._theta, x)
            else:
                noise = torch.randn(len(x), self._policy.action_size, generator=self._generator)
                action = self._policy.act(self._theta, x, noise)
        return action.double().numpy()


def load_policy(path: Path, algorithm: str, seed: int) -> TrainedPolicy:
    """Load the policy of one checkpoint of `algorithm`. Raises RunError where it is corrupt or does not fit."""
    arrays, state = checkpoint.read(path, algorithm)
    if len(state.policy_sizes) < 2 or min(state.policy_sizes) < 1:
        raise RunError(f"{path}: policy_sizes = {list(state.policy_sizes)} is no network: use another checkpoint")
    policy = GaussianPolicy(Mlp(state.policy_sizes))
    length = policy.network.num_parameters + policy.action_size
    checkpoint.check_shapes(path, arrays, {checkpoint.POLICY: (length,)})
    theta = torch.from_numpy(np.array(arrays[checkpoint.POLICY], np.float32))
    if not bool(torch.isfinite(theta).all()):
        raise RunError(f"{path}: the policy's parameters are not finite: use an earlier checkpoint")
    return TrainedPolicy(policy, theta, seed)
