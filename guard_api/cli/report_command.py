"""`guard report`: training runs as a table beside published results, or the report of a transfer directory again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from guard_api.cli.options import parse
from guard_api.cli.output import print_json, print_table
from guard_api.errors import SpecError
from guard_api.measure.learning import by_environment, read_groups
from guard_api.measure.report import write_report
from guard_api.measure.scores import Scores, markdown, notes, read_published, score, table


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which directories, and what beside them."""

    out: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Directory of a finished `guard transfer`, or run directories, or folders of them."""
    published: Path | None = None
    """CSV of published results, with the columns task, robot, constraint, algorithm, J_r, M_c and rho_c."""
    epochs: int = 1
    """Last epochs that J_r and M_c are means of; GUARD's paper reads one."""
    markdown: bool = False
    """Print the table of the runs as Markdown."""
    json: bool = False
    """Print JSON."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    text = "Tabulate training runs beside published results; or write report.html of a transfer directory again."
    options = parse(Options, "report", argv, text)
    if not options.out:
        raise SpecError("name a directory of `guard transfer`, or run directories, or folders of them")
    if len(options.out) == 1 and any((options.out[0] / name).exists() for name in ("plan.json", "transfer.json")):
        return _report_transfer(options.out[0], options.json)
    if options.epochs < 1:
        raise SpecError(f"--epochs is {options.epochs}: it must be at least 1")
    published = {} if options.published is None else read_published(options.published)
    scores = score(read_groups(options.out), published, options.epochs)
    if options.json:
        print_json({"epochs": options.epochs, "groups": [one.to_json() for one in scores]})
    elif options.markdown:
        print(markdown(scores), end="")
    else:
        _print(scores)
    return 0


def _report_transfer(out: Path, as_json: bool) -> int:
    report = str(write_report(out))
    if as_json:
        print_json({"report": report})
    else:
        print(report)
    return 0


def _print(scores: Sequence[Scores]) -> None:
    for env, members in by_environment(scores).items():
        head, *rows = table(members)
        print_table(env, head, rows)
    for note in notes(scores):
        print(note)
