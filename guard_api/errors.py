"""The errors GUARD raises on purpose: one line each, naming the file or field, the value and the remedy."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Final

LISTED: Final = 20
"""Most known names that a message about an unknown one lists."""


class GuardError(Exception):
    """Base of every error that a user can act on; the command line prints it as one line and exits with 2."""


class SpecError(GuardError):
    """A name, flag or specification that means nothing or contradicts itself."""


class ModelError(GuardError):
    """A robot file that cannot be used. Its message lists *all* problems, one per line, with line numbers.

    notes: what else the files hold that the user should know, such as ignored tags.
    """

    def __init__(self, message: str, notes: Iterable[str] = ()) -> None:
        super().__init__(message)
        self.notes = tuple(notes)


class PluginError(GuardError):
    """A backend, algorithm or robot that is not installed, cannot be imported or was written for another API."""


class BackendError(GuardError):
    """A backend that cannot build, step, save or restore what it was asked to."""


class RunError(GuardError):
    """A run directory, checkpoint or result file that is missing, foreign, corrupt or cannot be written."""


def unknown_name(kind: str, name: str, known: Iterable[str]) -> SpecError:
    """Return the error for an unknown `name`, with the nearest known names as the remedy."""
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    shown = [*known[:LISTED], f"and {len(known) - LISTED} more: see `guard list`"] if len(known) > LISTED else known
    remedy = f"did you mean {', '.join(near)}?" if near else f"known: {', '.join(shown) or 'none'}"
    return SpecError(f"unknown {kind} {name!r}: {remedy}")
