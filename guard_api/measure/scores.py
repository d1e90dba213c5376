"""The paper's three numbers of a training, J_r, M_c and rho_c, beside published ones.

J_r: mean return of the episodes that finished in the last epoch. M_c: their mean cost. rho_c: the cost of all steps of
the training, divided by their number. Source: Zhao et al. 2024, section 6; its tables average over seeds.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from guard_api.errors import RunError
from guard_api.measure.learning import Group, by_environment
from guard_api.measure.statistics import ADVISED_SEEDS, MIN_SEEDS, Estimate

COLUMNS: Final = {"J_r": "return_mean", "M_c": "cost_mean", "rho_c": "cost_rate"}
"""Score -> the column of progress.csv that it is read from."""

Published = Mapping[tuple[str, str], Mapping[str, float]]
"""(environment, algorithm in lower case) -> score -> value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """One group's scores after `steps` steps, and the published ones, if any. notes: what to beware of."""

    env: str
    algorithm: str
    backend: str
    seeds: list[int]
    steps: int
    scores: dict[str, Estimate]
    published: dict[str, float] | None
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON data."""
        return asdict(self)


def score(groups: Sequence[Group], published: Published, epochs: int = 1) -> list[Scores]:
    """Return the scores of every group; J_r and M_c over the last `epochs`, where the paper has one."""
    return [
        Scores(
            env=group.env,
            algorithm=group.label,
            backend=group.backend,
            seeds=group.seeds,
            steps=int(group.steps[-1]),
            scores={name: group.final(column, 1 if name == "rho_c" else epochs) for name, column in COLUMNS.items()},
            published=_copy(published.get((group.env, group.algorithm.lower()))),
            notes=_notes(group),
        )
        for group in groups
    ]


def read_published(file: Path) -> Published:
    """Return the rows of a CSV with the columns task, robot, constraint, algorithm, J_r, M_c and rho_c.

    Raises RunError naming the line that does not fit.
    """
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"{file}: cannot be read: {error}") from error
    result: dict[tuple[str, str], dict[str, float]] = {}
    for number, row in enumerate(rows, start=1):
        try:
            env = f"{row['task']}_{row['robot']}_{row['constraint']}"
            result[env, row["algorithm"].lower()] = {name: float(row[name]) for name in COLUMNS}
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            needed = "task, robot, constraint, algorithm, J_r, M_c and rho_c"
            raise RunError(f"{file}: row {number}: {error!r}: the columns must be {needed}") from error
    if not result:
        raise RunError(f"{file}: holds no results")
    return result


def markdown(scores: Sequence[Scores]) -> str:
    """Return the scores as Markdown, a table for each environment, and their notes."""
    lines: list[str] = []
    for env, members in by_environment(scores).items():
        head, *rows = table(members)
        lines += [f"**{env}**", "", _line(head), _line(["---"] * len(head)), *map(_line, rows), ""]
    return "\n".join([*lines, *(f"* {note}" for note in notes(scores))]) + "\n"


def notes(scores: Sequence[Scores]) -> list[str]:
    """Return what to beware of, each once."""
    return sorted({note for one in scores for note in one.notes})


def table(scores: Sequence[Scores]) -> list[list[str]]:
    """Return the scores of one environment as text: the heads of the columns, then the rows."""
    with_published = any(one.published for one in scores)
    head = ["algorithm", "backend", "seeds", "steps"]
    for name in COLUMNS:
        head += [name, "published"] if with_published else [name]
    rows = [head]
    for one in scores:
        row = [one.algorithm, one.backend, str(len(one.seeds)), f"{one.steps / 1e6:.3g} M"]
        for name in COLUMNS:
            row.append(_estimate(one.scores[name]))
            if with_published:
                row.append(_number(one.published[name]) if one.published else "")
        rows.append(row)
    return rows


def _estimate(estimate: Estimate) -> str:
    if estimate.value is None:
        return "undefined"
    text = _number(estimate.value)
    if estimate.low is None or estimate.high is None:
        return text
    return f"{text} [{_number(estimate.low)}, {_number(estimate.high)}]"


def _number(value: float) -> str:
    return f"{value:.4f}" if abs(value) < 0.1 else f"{value:.2f}"


def _notes(group: Group) -> tuple[str, ...]:
    found = []
    if len(group.runs) < MIN_SEEDS:
        found.append(f"No interval below {MIN_SEEDS} seeds: another seed may give another answer.")
    elif len(group.runs) < ADVISED_SEEDS:
        found.append(f"Intervals from fewer than {ADVISED_SEEDS} seeds are too narrow.")
    if group.uneven:
        found.append(f"{group.env}, {group.label} in {group.backend}: read where the shortest of its runs ends.")
    return tuple(found)


def _copy(values: Mapping[str, float] | None) -> dict[str, float] | None:
    return None if values is None else dict(values)


def _line(row: Sequence[str]) -> str:
    return f"| {' | '.join(row)} |"
