"""Output: one human table on a terminal, JSON on request."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

WIDEST = 400
"""Columns of text beyond which no table is laid out."""


def print_json(data: Any) -> None:
    """Print `data` as indented JSON; NaN and infinities, which JSON lacks, become null."""
    print(json.dumps(_finite(data), indent=2, allow_nan=False))


def print_table(title: str, columns: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    """Print a table: as wide as the terminal, or as its words need where it goes into a file or pipe."""
    table = Table(title=title, title_justify="left", header_style="bold")
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*(_cell(value) for value in row))
    console = Console(soft_wrap=False, markup=False)  # units in [brackets] are no markup
    if not console.is_terminal:
        natural = Measurement.get(console, console.options.update(max_width=WIDEST), table).maximum
        console = Console(soft_wrap=False, markup=False, width=max(console.width, natural))
    console.print(table)


def print_line(line: str, console: Console, to_stderr: bool) -> None:
    """Print `line` above the progress bars of `console`, or `to_stderr` for a command whose output is JSON."""
    if to_stderr:
        print(line, file=sys.stderr)
    else:
        console.print(line, markup=False)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return str(value)


def _finite(data: Any) -> Any:
    if isinstance(data, float):
        return data if abs(data) < float("inf") else None
    if isinstance(data, dict):
        return {str(key): _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    return data
