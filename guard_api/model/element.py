"""Strict reading of XML elements: every fault is reported with its line, and reading goes on."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  a compiled module without stubs

from guard_api.model.problems import LARGEST_NUMBER, Problems

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def parse(path: Path, problems: Problems) -> Element | None:
    """Return the root element of an XML file; None, with the parser's complaints reported, when it is not XML."""
    parser = etree.XMLParser(remove_comments=True, remove_pis=True, resolve_entities=False, no_network=True)
    try:
        root = etree.fromstring(path.read_bytes(), parser)
    except OSError as error:
        problems.error(str(path), f"cannot be read: {error.strerror}")
    except etree.XMLSyntaxError as error:
        for entry in parser.error_log:
            problems.error(f"{path}:{entry.line}", f"malformed XML: {entry.message.strip()}")
        if not parser.error_log:
            problems.error(str(path), f"malformed XML: {error}")
    else:
        return Element(root, path, problems)
    return None


class Element:
    """One element of a file. Readers of attributes return a usable stand-in after they have reported a fault."""

    def __init__(self, element: etree._Element, file: Path, problems: Problems) -> None:
        self.tag = str(element.tag)
        self.attributes = {str(key): str(value) for key, value in element.attrib.items()}
        self.line = int(element.sourceline or 0)
        self.file = file
        self.problems = problems
        self._element = element

    def error(self, message: str) -> None:
        """Report that the robot cannot be used because of this element."""
        self.problems.error(f"{self.file}:{self.line}", message)

    def note(self, message: str) -> None:
        """Report something that the user should know of this element."""
        self.problems.note(f"{self.file.name}:{self.line}: {message}")

    def children(self, tag: str | None = None) -> Iterator[Element]:
        """Yield the child elements called `tag`, or all of them, in file order."""
        for child in self._element.iterchildren(etree.Element):
            if tag is None or child.tag == tag:
                yield Element(child, self.file, self.problems)

    def child(self, tag: str, *, required: bool = False) -> Element | None:
        """Return the only child called `tag`; report a second one, and its absence if it is `required`."""
        found = list(self.children(tag))
        for extra in found[1:]:
            extra.error(f"<{self.tag}> has more than one <{tag}>: keep one")
        if required and not found:
            self.error(f"<{self.tag}> has no <{tag}>: add one")
        return found[0] if found else None

    def text(self, name: str) -> str:
        """Return the attribute `name`; report it as missing when it is absent or empty."""
        value = self.attributes.get(name, "").strip()
        if not value:
            self.error(f"<{self.tag}> has no {name}: add {name}=...")
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """Return the finite number in attribute `name`; `default` when absent, or report it as missing without one."""
        if default is not None and name not in self.attributes:
            return default
        return self.vector(name, 1, None if default is None else (default,))[0]

    def vector(self, name: str, size: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """Return the `size` finite numbers in attribute `name`; absent and faulty ones as in `number`."""
        stand_in = default or (1.0,) * size
        if name not in self.attributes:
            if default is None:
                self.error(f"<{self.tag}> has no {name}: add {name}=...")
            return stand_in
        words = self.attributes[name].split()
        if len(words) != size:
            self.error(f"<{self.tag}> {name}={self.attributes[name]!r} has {len(words)} numbers instead of {size}")
            return stand_in
        values = tuple(float(word) if _NUMBER.fullmatch(word) else math.nan for word in words)
        usable = [abs(value) <= LARGEST_NUMBER for value in values]  # False for NaN
        for word, fine in zip(words, usable, strict=True):
            if not fine:
                self.error(f"<{self.tag}> {name}: {word!r} is not a finite number")
        return values if all(usable) else stand_in
