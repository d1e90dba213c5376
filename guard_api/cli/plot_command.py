"""`guard plot`: learning curves of training runs, as PNG and as one offline HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from guard_api.cli.options import parse
from guard_api.cli.output import print_json
from guard_api.errors import SpecError
from guard_api.measure.learning import read_groups
from guard_api.measure.learning_curves import write_curves


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Which runs, and where the pictures go."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Run directories, or folders of them at any depth; runs that are still training may be among them."""
    out: Path = Path()
    """Folder for curves.html and one curves_{env}.png for each environment."""
    json: bool = False
    """Print the paths as JSON."""


def main(argv: Sequence[str]) -> int:
    """Run the command."""
    options = parse(Options, "plot", argv, "Draw learning curves of training runs, with intervals over seeds.")
    if not options.runs:
        raise SpecError("name run directories, or folders of them")
    files = [str(file) for file in write_curves(read_groups(options.runs), options.out)]
    if options.json:
        print_json({"files": files})
    else:
        print("\n".join(files))
    return 0
