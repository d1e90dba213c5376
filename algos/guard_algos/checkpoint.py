"""What a checkpoint of a training holds, and putting it back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from guard_algos.config import OnPolicyConfig
from guard_api.algorithm import TrainingJob, deciding_names, deciding_options
from guard_api.errors import GuardError, RunError
from guard_api.runs.checkpoint import load_checkpoint

POLICY = "policy"
"""Key of the policy's parameters."""
_GENERATOR = "generator"

Config = TypeVar("Config", bound=OnPolicyConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingState:
    """What is not a tensor: where the training stands, and what it must be continued with.

    policy_sizes: widths of the policy's network, observation first and action last. job: see `identity`. cost_names:
    the environment's, in order (empty in a checkpoint that was written before they were kept). best: how
    good the best policy so far was (`best.Standing`; None likewise: then the best is sought among the epochs to come).
    """

    algorithm: str
    policy_sizes: tuple[int, ...]
    job: dict[str, Any]
    epoch: int
    total_steps: int
    cumulative_cost: float
    cost_names: tuple[str, ...] = ()
    best: tuple[bool, float] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the state as JSON data."""
        return json.loads(json.dumps(asdict(self)))


def identity(job: TrainingJob) -> dict[str, Any]:
    """Return as JSON data what must be the same for a resumed training to give the same bits."""
    return {
        "environment": job.env.spec.fingerprint,
        "backend": job.env.backend_name,
        "num_worlds": job.env.num_worlds,
        "seed": job.seed,
        "layout_seed": job.env.seed,
        **deciding_options(job.config),
    }


def to_arrays(tensors: Mapping[str, Tensor], generator: torch.Generator) -> dict[str, NDArray[Any]]:
    """Return copies of the learned `tensors` and of the state of `generator`."""
    live = {**tensors, _GENERATOR: generator.get_state()}
    return {name: tensor.numpy().copy() for name, tensor in live.items()}


def read(path: Path, algorithm: str) -> tuple[dict[str, NDArray[Any]], TrainingState]:
    """Read one checkpoint. Raises RunError where it is missing, corrupt, incomplete or another algorithm's."""
    arrays, state = load_checkpoint(path)
    found = state.get("algorithm")
    if found != algorithm:
        raise RunError(f"{path}: is a checkpoint of algorithm {found!r}, not {algorithm!r}: load it with that one")
    try:
        names = tuple(state.get("cost_names", ()))
        training = TrainingState(**{**state, "policy_sizes": tuple(state["policy_sizes"]), "cost_names": names})
    except (TypeError, KeyError) as error:
        raise RunError(f"{path}: its state is not that of a training ({error}): use another checkpoint") from error
    return arrays, training


def restore(
    path: Path, algorithm: str, job: TrainingJob, tensors: Mapping[str, Tensor], generator: torch.Generator
) -> TrainingState:
    """Write the checkpoint `path` into the live `tensors` and `generator`; return the rest of it.

    Raises RunError where the checkpoint is of another job or network than the one that goes on.
    """
    arrays, state = read(path, algorithm)
    for name, value in identity(job).items():
        if state.job.get(name) != value:
            raise RunError(
                f"{path}: was trained with {name} = {state.job.get(name)}, not {value}: "
                "resume with that, or start a new run"
            )
    check_shapes(path, arrays, {_GENERATOR: tuple(generator.get_state().shape)})
    fill(path, arrays, tensors)
    generator.set_state(torch.from_numpy(np.array(arrays[_GENERATOR])))
    return state


def read_config(path: Path, state: TrainingState, config_type: type[Config]) -> Config:
    """Return the options that the training was started with. Raises RunError where they do not fit `config_type`."""
    names = deciding_names(config_type)
    try:
        values: dict[str, Any] = {name: state.job[name] for name in names}
        values["hidden"] = tuple(values["hidden"])  # JSON has no tuples
        return config_type(**values)
    except (KeyError, GuardError) as error:
        raise RunError(f"{path}: its options do not fit this GUARD ({error}): use another checkpoint") from error


def fill(path: Path, arrays: Mapping[str, NDArray[Any]], tensors: Mapping[str, Tensor]) -> None:
    """Write the checkpoint's `arrays` into the live `tensors` of the same names. Raises RunError where they differ."""
    check_shapes(path, arrays, {name: tuple(tensor.shape) for name, tensor in tensors.items()})
    for name, tensor in tensors.items():
        tensor.copy_(torch.from_numpy(arrays[name]))


def check_shapes(path: Path, arrays: Mapping[str, NDArray[Any]], expected: Mapping[str, tuple[int, ...]]) -> None:
    """Raise RunError unless `arrays` holds every `expected` name with its shape."""
    for name, shape in expected.items():
        found = arrays[name].shape if name in arrays else "missing"
        if found != shape:
            raise RunError(f"{path}: tensor {name!r} is {found}, expected {shape}: use a checkpoint of this training")
