"""Run directories as a training leaves them, without a training."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from guard_api.runs.directory import RunDirectory


def leave_run(
    path: Path, values: Sequence[float], *, seed: int = 0, algorithm: str = "cpo", env: str = "Goal_Point_8Hazards",
    backend: str = "mujoco", config: dict | None = None,
) -> Path:  # fmt: skip
    """Make a run whose epoch k has the return values[k], a tenth of it as cost, and so on."""
    manifest = {
        "env": env,
        "spec_fingerprint": "0123456789abcdef",
        "algorithm": algorithm,
        "backend": backend,
        "num_worlds": 30,
        "seed": seed,
        "preset": None,
        "versions": {"guard": "1"},
    }
    run = RunDirectory.create(path, manifest=manifest, config=config or {"cost_limit": 0.0, "threads": seed})
    for k, value in enumerate(values, start=1):
        row = {"epoch": k, "total_steps": 1000.0 * k, "return_mean": value, "cost_mean": value / 10}
        run._progress.append(row | {"cost_rate": value / 10_000, "violation_rate": value / 100})
    return path
