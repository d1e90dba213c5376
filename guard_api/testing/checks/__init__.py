"""The conformance checks, one module per concern; `ALL` lists them in the order of the clauses."""

from guard_api.testing.checks import (
    acceleration,
    actuation,
    contact,
    failure,
    frames,
    isolation,
    mechanics,
    motion,
    pushing,
    shapes,
    snapshot,
    standing,
    stepping,
    thrust,
    touch,
)
from guard_api.testing.checks.check import Check

_MODULES = (
    frames,
    mechanics,
    acceleration,
    shapes,
    stepping,
    actuation,
    thrust,
    touch,
    isolation,
    failure,
    snapshot,
    motion,
    contact,
    pushing,
    standing,
)

ALL: tuple[Check, ...] = tuple(
    sorted(
        (item for module in _MODULES for item in vars(module).values() if isinstance(item, Check)),
        key=lambda item: int(item.clause[1:]),
    )
)
"""Every check of the suite."""
