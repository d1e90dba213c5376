"""A grid of trainings as data: every environment x algorithm x backend x seed, each in a folder with a telling name."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import product
from pathlib import Path
from typing import Any

from guard_api import plugins
from guard_api.algorithm import Algorithm, find_preset
from guard_api.errors import SpecError, unknown_name
from guard_api.measure.training import Training
from guard_api.suite import make_spec
from guard_api.typed import Reader


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """What to train. total_steps and num_worlds are the preset's where left out, or a million and 30.

    options: option -> value, for every algorithm that has it; algorithm -> table of options, for that one, which win.
    """

    envs: tuple[str, ...]
    algos: tuple[str, ...]
    backends: tuple[str, ...] = ("mujoco",)
    seeds: tuple[int, ...] = (0,)
    total_steps: float | None = None
    num_worlds: int | None = None
    preset: str = ""
    options: dict[str, Any] = field(default_factory=dict)

    def trainings(self, out: Path) -> list[Training]:
        """Return the trainings, each in `out/{env}_{algo}_{backend}_seed{k}`; those of one seed before the next.

        Raises SpecError for names, options or numbers that mean nothing.
        """
        for name in ("envs", "algos", "backends", "seeds"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise SpecError(f"{name} = {list(values)}: give at least one, each once")
        specs = [make_spec(env) for env in self.envs]
        names = [spec.name for spec in specs]
        if len(set(names)) < len(names):
            raise SpecError(f"envs = {list(self.envs)}: two are called the same, and so would their runs be")
        for backend in self.backends:
            plugins.load("guard.backends", backend)
        algorithms = [plugins.load("guard.algorithms", name) for name in self.algos]
        self._check_options(algorithms)
        settings = [self._settings(algorithm) for algorithm in algorithms]
        return [
            Training(
                path=out / f"{spec.name}_{setting['algorithm']}_{backend}_seed{seed}",
                spec=spec,
                backend=backend,
                seed=seed,
                **setting,
            )
            for seed, spec, backend, setting in product(self.seeds, specs, self.backends, settings)
        ]

    def _settings(self, algorithm: Algorithm) -> dict[str, Any]:
        """Return what the trainings of one algorithm share."""
        preset = find_preset(algorithm, self.preset) if self.preset else None
        total_steps = self.total_steps if self.total_steps is not None else preset.total_steps if preset else 1e6
        num_worlds = self.num_worlds if self.num_worlds is not None else preset.num_worlds if preset else 30
        if not 1 <= total_steps < float("inf"):
            raise SpecError(f"total_steps = {total_steps}: must be at least 1")
        size = {"total_steps": int(total_steps), "num_worlds": num_worlds}
        config = self._config(algorithm, preset.options if preset else {})
        said = {"name": self.preset, "changed": preset.changed(**size, config=config)} if preset else None
        return {"algorithm": algorithm.name, "config": config, "preset": said, **size}

    def _config(self, algorithm: Algorithm, preset: Mapping[str, Any]) -> Any:
        known = _options(algorithm)
        shared = {name: value for name, value in self.options.items() if name in known}
        reader = Reader({})
        data = {**preset, **shared, **self.options.get(algorithm.name, {})}
        config = reader.read(algorithm.config_type, data, f"options of {algorithm.name}")
        if config is None:
            raise SpecError("\n".join(reader.faults))
        return config

    def _check_options(self, algorithms: Sequence[Algorithm]) -> None:
        """Refuse an option that no algorithm of the grid has: it would silently change nothing."""
        shared = {name for algorithm in algorithms for name in _options(algorithm)}
        for name, value in self.options.items():
            if name in self.algos:
                if not isinstance(value, Mapping):
                    raise SpecError(f"options.{name} is {value!r}: it must be a table of options, as {name}.gamma=0.9")
            elif name not in shared:
                raise unknown_name("option, or algorithm of the grid,", name, shared | set(self.algos))


def read_grid(file: Path | None, given: Mapping[str, Any]) -> Grid:
    """Return the grid in the TOML `file`, if any, with the keys that are `given` in place of its own.

    Raises SpecError with every problem, one per line, that names the file and the key.
    """
    data: dict[str, Any] = {}
    if file is not None:
        try:
            data = tomllib.loads(file.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise SpecError(f"{file}: cannot be read: {error}") from error
    merged = {**data, **given}
    if isinstance(data.get("options"), Mapping) and "options" in given:
        merged["options"] = {**data["options"], **given["options"]}
    reader = Reader({})
    grid = reader.read(Grid, merged)
    if grid is None:
        where = f"{file}: " if file is not None else "the grid: "
        raise SpecError("\n".join(where + fault for fault in reader.faults))
    return grid


def parse_options(texts: Sequence[str]) -> dict[str, Any]:
    """Return the options in `texts`, such as "threads=1" or "cpo.cost_limit=2": values are written as in TOML."""
    try:
        return tomllib.loads("\n".join(texts))
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"--options {' '.join(texts)}: {error}: write name=value or algorithm.name=value") from error


def _options(algorithm: Algorithm) -> set[str]:
    return {field.name for field in fields(algorithm.config_type)}
