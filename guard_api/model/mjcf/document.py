"""What all readers of one MJCF file share: its settings, classes and assets, and what was left out of it."""

from __future__ import annotations

from dataclasses import dataclass, field

from guard_api.model.element import Element
from guard_api.model.mjcf.assets import Assets, read_assets
from guard_api.model.mjcf.compiler import Compiler, read_compiler
from guard_api.model.mjcf.defaults import Defaults


class Omissions:
    """Values that the neutral model has no place for, listed once per kind with how often and where first."""

    def __init__(self) -> None:
        self._places: dict[str, list[Element]] = {}

    def add(self, sentence: str, node: Element) -> None:
        """Record that `sentence` holds for `node`."""
        self._places.setdefault(sentence, []).append(node)

    def report(self) -> None:
        """Note every sentence recorded."""
        for sentence, places in self._places.items():
            times = f"{len(places)} times, first at" if len(places) > 1 else "at"
            first = places[0]
            first.problems.note(f"{first.file.name}: {sentence} ({times} line {first.line})")


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """The settings of one file."""

    compiler: Compiler
    defaults: Defaults
    assets: Assets
    omissions: Omissions = field(default_factory=Omissions)


def read_document(root: Element) -> Document:
    """Return the settings of the file whose outermost element is `root`."""
    compiler, defaults = read_compiler(root), Defaults(root)
    return Document(compiler=compiler, defaults=defaults, assets=read_assets(root, compiler, defaults))
