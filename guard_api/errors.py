"""The errors GUARD raises on purpose: one line each, naming the file or field, the value and the remedy."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class GuardError(Exception):
    """Base of every error that a user can act on; the command line prints it as one line and exits with 2."""


class SpecError(GuardError):
    """A name, flag or specification that means nothing or contradicts itself."""


class ModelError(GuardError):
    """A robot file that cannot be used. Its message lists *all* problems, one per line, with line numbers."""


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
    remedy = f"did you mean {', '.join(near)}?" if near else f"known: {', '.join(known) or 'none'}"
    return SpecError(f"unknown {kind} {name!r}: {remedy}")
