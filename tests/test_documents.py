"""The documents: links lead somewhere, commands exist, nothing is left to fill in."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from guard_api.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = [
    *ROOT.glob("*.md"),
    *ROOT.glob("docs/*.md"),
    *ROOT.glob("backends/*/README.md"),
    *ROOT.glob("results/*.md"),
]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_relative_links_exist(document: Path) -> None:
    targets = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", document.read_text())
    missing = [t for t in targets if "://" not in t and not (document.parent / t).exists()]
    assert not missing


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_is_left_to_fill_in(document: Path) -> None:
    assert not re.search(r"TODO|TBD|FIXME|[A-Z]+_(TABLE|HERE)\b", document.read_text())


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_exist(document: Path) -> None:
    named = set(re.findall(r"^(?:\.venv/bin/)?guard +([a-z]+)", document.read_text(), flags=re.MULTILINE))
    assert named <= set(COMMANDS)
