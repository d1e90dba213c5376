"""What decides a run's numbers, written beside them: versions, machine, specification, assets and command."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import guard_api
from guard_api.model.library import robot_files
from guard_api.physics.backend import Backend

if TYPE_CHECKING:
    from guard_api.spec import EnvSpec


def build_manifest(
    *,
    env_spec: EnvSpec,
    backend: Backend,
    algorithm: str,
    seed: int,
    num_worlds: int,
    total_steps: int,
    preset: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the manifest of a training run, JSON-serialisable; unknown facts are None, never guessed.

    preset: its name, and what of the settings was `changed`; None where there was none.
    """
    return {
        "env": env_spec.name,
        "spec": env_spec.to_json(),
        "spec_fingerprint": env_spec.fingerprint,
        "backend": backend.name,
        "algorithm": algorithm,
        "seed": seed,
        "num_worlds": num_worlds,
        "total_steps": total_steps,
        "preset": preset,
        "versions": {**package_versions(), **backend.versions()},
        "assets": asset_hashes(env_spec.robot),
        **describe_machine(),
    }


def describe_machine() -> dict[str, Any]:
    """Return git state, hardware, platform, command line and the time, as every result file of GUARD records them."""
    return {
        "git": git_state(Path(guard_api.__file__).parent),
        "hardware": {"cpu": cpu_model(), "cores": os.cpu_count(), "memory_bytes": memory_bytes()},
        "platform": platform.platform(),
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def package_versions() -> dict[str, str]:
    """Return the versions of what decides the numbers: GUARD, Python, NumPy and, where installed, PyTorch and numba."""
    versions = {"guard": guard_api.__version__, "python": platform.python_version(), "numpy": np.__version__}
    for optional in ("torch", "numba"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[optional] = metadata.version(optional)
    return versions


def asset_hashes(robot: str) -> dict[str, str]:
    """Return file, relative to the robot's folder -> SHA-256. Raises SpecError for an unknown robot."""
    files = robot_files(robot)
    folder = os.path.commonpath([file.parent for file in files])
    return {file.relative_to(folder).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


@functools.cache  # the code that runs is the one that was imported
def git_state(folder: Path) -> dict[str, Any] | None:
    """Return the commit of the checkout around `folder` and whether it has changes; None outside a checkout."""
    commit = _git(folder, "rev-parse", "HEAD")
    if commit is None:
        return None
    return {"commit": commit, "dirty": bool(_git(folder, "status", "--porcelain", "--untracked-files=no"))}


def cpu_model() -> str | None:
    """Return the processor's name as the system states it."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        match = re.search(r"^model name\s*:\s*(.+)$", info.read_text(), re.MULTILINE)
        if match:
            return match.group(1)
    return platform.processor() or None


def memory_bytes() -> int | None:
    """Return the size of the main memory [bytes]."""
    names = getattr(os, "sysconf_names", {})
    if "SC_PHYS_PAGES" not in names:
        return None
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=10, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
