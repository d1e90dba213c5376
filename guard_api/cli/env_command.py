"""`guard env`: what environments consist of, observe and cost, and a picture of how their episodes start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.env import Environment, make_environment
from guard_api.errors import SpecError
from guard_api.viewer import CELL, Cell, captioned_sheet, environment_picture, write_png


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which environments to show, and how."""

    envs: Annotated[tuple[str, ...], tyro.conf.Positional]
    """Environments, such as Goal_Point_8Hazards, or TOML files that specify one."""
    seed: int = 0
    """Seed of the layout in the picture."""
    out: Path | None = None
    """Picture to write (PNG): of one environment, or a captioned sheet of several."""
    json: bool = False
    """Print JSON instead of tables."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "env", argv, "Show environments.")
    if not options.envs:
        raise SpecError("name an environment, such as Goal_Point_8Hazards (`guard list envs`), or a TOML file of one")
    # What is shown is the same on every backend; this one needs no engine.
    shown = [make_environment(name, backend="ideal", seed=options.seed) for name in options.envs]
    rows = [_describe(env) for env in shown]
    if options.out is not None:
        write_png(
            options.out,
            environment_picture(shown[0]) if len(shown) == 1 else captioned_sheet([_cell(e) for e in shown]),
        )
    if options.json:
        print_json(rows)
        return 0
    for row in rows:
        print_table(
            row["name"], ("what", "value"), ((key, str(value)) for key, value in row.items() if key != "layout")
        )
        print_table("observation", ("reading", "from", "to"), ((k, a, b) for k, (a, b) in row["layout"].items()))
    if options.out is not None:
        print(f"picture: {options.out}")
    return 0


def _describe(env: Environment) -> dict[str, Any]:
    return {
        "name": env.spec.name,
        "fingerprint": env.spec.fingerprint,
        "robot": env.spec.robot,
        "observation": env.observation_size,
        "action": env.action_size,
        "costs": list(env.cost_names),
        "step": f"{env.duration:g} s",
        "episode": f"{env.episode_length} steps",
        "objects": [f"{group.count} {group.name} ({group.body.physics})" for group in env.groups],
        "layout": {name: [part.start, part.stop] for name, part in env.observation_layout.items()},
    }


def _cell(env: Environment) -> Cell:
    kinds = {"driven": "solid "}  # the other kinds show
    objects = ", ".join(f"{group.count} {kinds.get(group.body.physics, '')}{group.name}" for group in env.groups)
    return Cell(title=env.spec.name, caption=objects, image=environment_picture(env, size=CELL))
