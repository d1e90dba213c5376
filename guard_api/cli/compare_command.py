"""`guard compare`: measure whether every robot is the same robot in every simulator, and make the page that says so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar, cast, get_args

import tyro
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from guard_api.cli.options import parse, whole_steps
from guard_api.cli.output import print_json, print_table
from guard_api.measure.bench import bench
from guard_api.measure.cells import Cell, run_cells
from guard_api.measure.conformance import checks_of, measure_conformance
from guard_api.measure.divergence import measure_divergence
from guard_api.measure.endurance import measure_endurance
from guard_api.measure.locomotion import measure_locomotion, moves_by_contact
from guard_api.measure.robots_page import lost_worlds, refresh, tables
from guard_api.measure.tapes import Drive
from guard_api.measure.targets import FIGURES, measure_targets
from guard_api.model.library import load_robot, robot_names
from guard_api.runs.atomic import write_text
from guard_api.scene.spec import ContactPreset
from guard_api.suite import SUITE_COUNT

RESULTS = Path("results/robots")


@dataclass(frozen=True, slots=True, kw_only=True)
class Which:
    """Which robots and simulators to compare, and where the results are kept."""

    robots: tuple[str, ...] = ()
    """Robots (`guard list robots`); all that the measurement is for when left out."""
    backends: tuple[str, ...] = ("mujoco", "bullet", "sapien")
    """Simulators."""
    out: Path = RESULTS
    """Folder of the result files. What they hold already is not measured again."""
    again: bool = False
    """Measure what they hold already too."""
    json: bool = False
    """Print the results as JSON instead of tables."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Divergence(Which):
    """Time until the same controls lead apart on two simulators, beside each simulator's own sensitivity."""

    worlds: int = 8
    """Random tapes of controls."""
    seconds: float = 5.0
    """Length of a tape [s]."""
    distance: float = 0.01
    """Distance of some link at which two motions have parted [m]."""
    measure: ClassVar = "divergence"

    def cells(self) -> list[Cell]:
        """Return one cell per robot."""
        settings = {"worlds": self.worlds, "seconds": self.seconds, "distance": self.distance}
        return [
            Cell(
                key={"robot": robot},
                robot=robot,
                backends=self.backends,
                settings={"backends": list(self.backends), **settings},
                measure=lambda robot=robot: measure_divergence(robot, self.backends, **settings),
            )
            for robot in self.robots or robot_names()
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Locomotion(Which):
    """Speed, height and foot contact of robots that move by contact, under the same controls."""

    seeds: int = 8
    """Tapes of controls; intervals are over them."""
    seconds: float = 10.0
    """Length of a tape [s]."""
    presets: tuple[ContactPreset, ...] = get_args(ContactPreset)
    """Contact settings."""
    drives: tuple[Drive, ...] = get_args(Drive)
    """Controls: random, or a sinusoidal gait."""
    refine: tuple[int, ...] = (1,)
    """Divide the robot's timestep by these, to see what of a difference is the timestep's."""
    measure: ClassVar = "locomotion"

    def cells(self) -> list[Cell]:
        """Return one cell per timestep, controls, robot, preset and simulator."""
        settings = {"seeds": self.seeds, "seconds": self.seconds}
        robots = self.robots or tuple(name for name in robot_names() if moves_by_contact(load_robot(name)))
        return [
            Cell(
                key={"refine": str(refine), "drive": drive, "robot": robot, "preset": preset, "backend": backend},
                robot=robot,
                backends=(backend,),
                settings=settings,
                measure=lambda r=robot, b=backend, p=preset, d=drive, n=refine: measure_locomotion(
                    r, b, preset=p, drive=d, refine=n, **settings
                ),
            )
            for refine, drive, robot, preset, backend in product(
                self.refine, self.drives, robots, self.presets, self.backends
            )
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Endurance(Which):
    """Environment steps under random actions, and the worlds that the physics lost on the way."""

    steps: float = 1e5
    """Environment steps over all worlds of each robot and simulator."""
    num_worlds: int = 64
    """Worlds stepped together."""
    seed: int = 0
    """Seed of layouts and actions."""
    task: str = "Goal"
    """Task, with eight hazards."""
    workers: int | None = None
    """Threads or processes that step the worlds; chosen by GUARD when left out. Changes no number."""
    measure: ClassVar = "endurance"

    def cells(self) -> list[Cell]:
        """Return one cell per robot and simulator."""
        settings = {"total_steps": whole_steps(self.steps), "num_worlds": self.num_worlds, "seed": self.seed}
        return [
            Cell(
                key={"robot": robot, "backend": backend},
                robot=robot,
                backends=(backend,),
                settings={"env": _env(self.task, robot), **settings},
                measure=lambda robot=robot, backend=backend: measure_endurance(
                    _env(self.task, robot), backend, workers=self.workers, **settings
                ),
            )
            for robot, backend in product(self.robots or robot_names(), self.backends)
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Conformance(Which):
    """What `guard conform` finds of each robot on each simulator."""

    measure: ClassVar = "conformance"

    def cells(self) -> list[Cell]:
        """Return one cell per robot and simulator."""
        cells = _by_robot_and_backend(self.robots or robot_names(), self.backends, measure_conformance)
        return [replace(cell, settings={"checks": checks_of(cell.robot)}) for cell in cells]


@dataclass(frozen=True, slots=True, kw_only=True)
class Targets(Which):
    """GUARD's own figures of its robots, on each simulator."""

    measure: ClassVar = "targets"

    def cells(self) -> list[Cell]:
        """Return one cell per robot and simulator."""
        return _by_robot_and_backend(self.robots or tuple(FIGURES), self.backends, measure_targets)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench(Which):
    """Environment steps per second, and the share of what the bare engine reaches; on a quiet machine."""

    num_worlds: int = 64
    """Worlds stepped together."""
    blocks: int = 250
    """Blocks of environment steps and of raw steps, taken in turns."""
    block_seconds: float = 0.02
    """About how long a block lasts [s]."""
    workers: int | None = None
    """Threads or processes that step the worlds; chosen by GUARD when left out."""
    measure: ClassVar = "bench"

    def cells(self) -> list[Cell]:
        """Return one cell per robot and simulator."""
        settings = {"num_worlds": self.num_worlds, "workers": self.workers, "blocks": self.blocks}
        settings = {**settings, "block_seconds": self.block_seconds}
        return [
            Cell(
                key={"robot": robot, "backend": backend},
                robot=robot,
                backends=(backend,),
                settings=settings,
                measure=lambda robot=robot, backend=backend: bench(
                    _env("Goal", robot), backend, **cast("dict[str, Any]", settings)
                ).to_json(),
            )
            for robot, backend in product(self.robots or robot_names(), self.backends)
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Make the tables of the page anew from the results; the text between them stays."""

    results: Path = RESULTS
    """Folder of the result files."""
    page: Path = Path("docs/robots.md")
    """Page to make."""


Measure = Conformance | Targets | Divergence | Locomotion | Endurance | Bench
Options = Annotated[
    Annotated[Conformance, tyro.conf.subcommand("conformance")]
    | Annotated[Targets, tyro.conf.subcommand("targets")]
    | Annotated[Divergence, tyro.conf.subcommand("divergence")]
    | Annotated[Locomotion, tyro.conf.subcommand("locomotion")]
    | Annotated[Endurance, tyro.conf.subcommand("endurance")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Page, tyro.conf.subcommand("page")],
    tyro.conf.ConsolidateSubcommandArgs,
]


def main(argv: Sequence[str]) -> int:
    """Run the command; exit code 1 when a simulator refused a robot or lost a world."""
    text = "Measure whether every robot is the same robot in every simulator."
    options = parse(cast("type[Measure | Page]", Options), "compare", argv, text)
    if isinstance(options, Page):
        write_text(options.page, refresh(options.page, options.results))
        return 0
    records = _measure(options)
    if options.json:
        print_json(records)
    else:
        for table in tables(options.measure, records):
            print_table(table.title, table.columns, table.rows)
    return 1 if any(_failed(record) for record in records) else 0


def _measure(options: Measure) -> list[dict[str, Any]]:
    cells = options.cells()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, disable=options.json) as progress:
        bar = progress.add_task(options.measure, total=len(cells))

        def report(cell: Cell, position: int) -> None:
            name = " ".join(cell.key.values())
            progress.update(bar, completed=position, description=f"{options.measure}: {name}")

        records = run_cells(options.out / f"{options.measure}.json", cells, again=options.again, report=report)
        progress.update(bar, completed=len(cells), description=options.measure)
    return records


def _failed(record: dict[str, Any]) -> bool:
    values = record.get("values")
    if values is None or any(check["status"] in ("failed", "error") for check in values.get("checks", ())):
        return True
    lost = values.get("lost", 0)
    ended = lost_worlds(values.get("failures", {}))
    return bool(ended or (sum(lost.values()) if isinstance(lost, dict) else lost))


def _by_robot_and_backend(
    robots: Sequence[str], backends: Sequence[str], measure: Callable[[str, str], dict[str, Any]]
) -> list[Cell]:
    return [
        Cell(
            key={"robot": robot, "backend": backend},
            robot=robot,
            backends=(backend,),
            settings={},
            measure=lambda robot=robot, backend=backend: measure(robot, backend),
        )
        for robot, backend in product(robots, backends)
    ]


def _env(task: str, robot: str) -> str:
    return f"{task}_{robot.capitalize()}_{SUITE_COUNT}Hazards"
