"""A trained policy as one ONNX file that needs neither GUARD nor PyTorch: it acts as in evaluation, corrected."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor

from guard_algos.checkpoint import TrainingState
from guard_algos.policy import TrainedPolicy
from guard_algos.rollout import Correct
from guard_api.errors import PluginError, RunError
from guard_api.runs.atomic import write_bytes

CONTRACT: Final = "guard.contract"
"""Key of the file's metadata that holds the contract, as JSON."""

TOLERANCE: Final = 1e-4
"""Largest difference of an action from PyTorch's that the self-test accepts; single precision leaves about 1e-6."""


class _Graph(torch.nn.Module):
    """From observations (N, O), and the costs (N, C) of the step before where they matter, to actions (N, A)."""

    def __init__(self, policy: TrainedPolicy, correct: Correct | None) -> None:
        super().__init__()
        self._policy, self._correct = policy, correct

    def forward(self, observation: Tensor, costs: Tensor) -> Tensor:
        action = self._policy.mean(observation)
        return action if self._correct is None else self._correct(observation, costs, action)


def write(
    policy: TrainedPolicy, correct: Correct | None, state: TrainingState, out: Path, contract: Mapping[str, Any]
) -> dict[str, Any]:
    """Write the deterministic `policy` to `out`, atomically; return the contract with the result of the self-test.

    The file's inputs are `observation` (N, O) and, only where a correction looks at them, `costs` (N, C), both float32;
    its output is `action` (N, A). `contract` says what these mean and is stored with the file.
    Raises PluginError without the packages, and RunError where `contract` is of another observation or action than the
    policy's, or the file does not act as the policy does.
    """
    sizes = (contract.get("observation_size"), contract.get("action_size"))
    if sizes != (state.policy_sizes[0], state.policy_sizes[-1]):
        raise RunError(f"{out}: not written: the environment has {sizes} observations and actions, not the policy's")
    example = _samples(state, 3)
    proto = _trace(_Graph(policy, correct), example)
    inputs = [value.name for value in proto.graph.input]
    complete = {
        **contract,
        "algorithm": state.algorithm,
        "inputs": inputs,
        "normaliser": "none: the policy sees the environment's observation as it is",
        "corrected": correct is not None,
        "self_test": {"samples": 256, "largest_difference": 0.0, "tolerance": TOLERANCE},
    }
    complete["self_test"]["largest_difference"] = _difference(proto.SerializeToString(), policy, _samples(state, 256))
    if not complete["self_test"]["largest_difference"] <= TOLERANCE:
        raise RunError(f"{out}: not written: its actions differ from the policy's: {complete['self_test']}")
    entry = proto.metadata_props.add()
    entry.key, entry.value = CONTRACT, json.dumps(complete)
    write_bytes(out, proto.SerializeToString())
    return complete


def _samples(state: TrainingState, count: int) -> tuple[Tensor, Tensor]:
    """Return random observations (count, O) and costs (count, C), half of these 0."""
    rng = np.random.default_rng(0)
    observation = rng.standard_normal((count, state.policy_sizes[0]))
    costs = np.maximum(rng.uniform(-1, 1, (count, len(state.cost_names))), 0.0)
    return torch.from_numpy(observation).float(), torch.from_numpy(costs).float()


def _trace(graph: _Graph, example: tuple[Tensor, Tensor]) -> Any:
    """Return the ONNX model of `graph`, for any number of worlds, without inputs that it does not use."""
    try:
        import onnx  # noqa: F401, PLC0415
        import onnxruntime  # noqa: F401, PLC0415
        import onnxscript  # noqa: F401, PLC0415
    except ImportError as error:
        raise PluginError(f"export needs {error.name}: pip install 'guard-api[export]'") from error
    worlds = torch.export.Dim("worlds", min=1)
    with _quiet(), torch.no_grad():
        program = torch.onnx.export(
            graph.eval(),
            example,
            input_names=["observation", "costs"],
            output_names=["action"],
            dynamic_shapes=({0: worlds}, {0: worlds}),
            dynamo=True,
            external_data=False,
            verbose=False,
        )
    assert program is not None
    proto = program.model_proto
    used = {name for node in proto.graph.node for name in node.input}
    for value in [value for value in proto.graph.input if value.name not in used]:
        proto.graph.input.remove(value)
    return proto


def _difference(model: bytes, policy: TrainedPolicy, samples: tuple[Tensor, Tensor]) -> float:
    """Return the largest difference of the file's actions from the policy's, in a batch and for a single world."""
    import onnxruntime  # noqa: PLC0415

    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    names = {value.name for value in session.get_inputs()}
    largest = 0.0
    for rows in (slice(None), slice(0, 1)):
        observation, costs = (x[rows].numpy() for x in samples)
        feed = {name: x for name, x in (("observation", observation), ("costs", costs)) if name in names}
        (action,) = session.run(None, feed)
        largest = max(largest, float(np.abs(np.asarray(action) - policy.act(observation, True, costs)).max()))
    return largest


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the exporter's own deprecations and advice, which no user can act on."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
