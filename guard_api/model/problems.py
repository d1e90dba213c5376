"""Collects everything that is wrong with a robot's files, so that a user mends them in one round."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from guard_api.errors import ModelError

NEAR = 0.75
"""Similarity from which an unknown word is taken for a misspelling of a known one rather than a foreign extension."""

LARGEST_NUMBER = 1e30
"""Magnitude beyond which a number in a file is refused like infinity: products of a few such numbers overflow."""


class Problems:
    """The errors and notes of one robot.

    An error says why the files cannot be used; a note says what was inferred, merged or ignored. Both are single
    lines; an error begins with its place, `file:line` for XML and `file: key` for TOML.
    """

    def __init__(self) -> None:
        self.errors: list[str] = []
        self.notes: list[str] = []

    def error(self, place: str, message: str) -> None:
        """Record that the robot cannot be used because of what stands at `place`."""
        self.errors.append(f"{place}: {message}")

    def note(self, message: str) -> None:
        """Record something the user should know; a repeated note is kept once."""
        if message not in self.notes:
            self.notes.append(message)

    def raise_if_any(self) -> None:
        """Raise ModelError with every recorded error if there is one."""
        if self.errors:
            raise self.as_error()

    def as_error(self) -> ModelError:
        """Return the ModelError that lists every recorded error, one per line, and has the notes."""
        return ModelError("\n".join(self.errors), self.notes)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that `word` is probably a misspelling of, or None."""
    near = difflib.get_close_matches(word, list(known), n=1, cutoff=NEAR)
    return near[0] if near else None


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return the remedy for an unknown `word`: the nearest known one, else all of them."""
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}"
