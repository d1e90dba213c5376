"""`guard report`: write the report of a transfer directory again, from its transfer.json alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from guard_api.cli.options import parse
from guard_api.cli.output import print_json
from guard_api.measure.report import write_report


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which directory."""

    out: Annotated[Path, tyro.conf.Positional]
    """Directory of a finished `guard transfer`."""
    json: bool = False
    """Print the path as JSON."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "report", argv, "Write report.html and matrix.png of a transfer directory.")
    report = str(write_report(options.out))
    if options.json:
        print_json({"report": report})
    else:
        print(report)
    return 0
