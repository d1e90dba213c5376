"""`guard export`: a trained policy as one ONNX file with the meaning of its inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from guard_api import plugins
from guard_api.cli.options import parse
from guard_api.cli.output import print_json
from guard_api.env import Environment, make_environment
from guard_api.errors import PluginError
from guard_api.measure.training import final_checkpoint
from guard_api.runs.directory import RunDirectory
from guard_api.spec import EnvSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which policy, and where to."""

    run: Annotated[Path, tyro.conf.Positional]
    """Run directory of the policy; its last checkpoint is used."""
    out: Path
    """ONNX file to write."""
    json: bool = False
    """Print the contract that is stored in the file as JSON."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "export", argv, "Write a trained policy as ONNX, tested against the policy itself.")
    run = RunDirectory.open(options.run)
    name, checkpoint = str(run.fact("algorithm")), final_checkpoint(run)
    algorithm = plugins.load("guard.algorithms", name)
    if not hasattr(algorithm, "export_policy"):
        raise PluginError(f"algorithm {name!r} has no export_policy: its policies cannot be exported")
    spec = EnvSpec.from_json(run.fact("spec"))
    with closing(make_environment(spec, backend=str(run.fact("backend")))) as env:
        written = algorithm.export_policy(checkpoint, options.out, contract(env))
    if options.json:
        print_json({"out": str(options.out), **written})
    else:
        test = written["self_test"]
        print(
            f"{options.out}: {', '.join(written['inputs'])} -> action, float32; "
            f"within {test['largest_difference']:.1e} of the policy on {test['samples']} random observations"
        )
    return 0


def contract(env: Environment) -> dict[str, Any]:
    """Return, as JSON data, what the inputs and outputs of a policy for `env` mean."""
    return {
        "format": "guard-onnx-1",
        "env": env.spec.name,
        "spec_fingerprint": env.spec.fingerprint,
        "step_duration": env.duration,
        "observation_size": env.observation_size,
        "observation": {name: [part.start, part.stop] for name, part in env.observation_layout.items()},
        "costs": list(env.cost_names),
        "costs_meaning": "of the step before; zeros at an episode's start",
        "action_size": env.action_size,
        "action": [{"actuator": a.name, "control": list(a.ctrl_range)} for a in env.robot.actuators],
        "action_meaning": "of the deterministic policy; the receiver clips it to [-1, 1], the ends of the control",
    }
