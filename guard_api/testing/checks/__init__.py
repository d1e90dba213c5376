"""The conformance checks, one module per concern; `ALL` lists them in the order of the clauses."""

from guard_api.testing.checks import frames, snapshot, stepping
from guard_api.testing.checks.check import Check

ALL: tuple[Check, ...] = tuple(
    sorted(
        (item for module in (frames, stepping, snapshot) for item in vars(module).values() if isinstance(item, Check)),
        key=lambda item: int(item.clause[1:]),
    )
)
"""Every check of the suite."""
