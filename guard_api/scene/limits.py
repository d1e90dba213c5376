"""What the numbers of tasks, constraints and sensors may be, said at their fields.

    size: float = field(default=0.3, metadata=POSITIVE)

A field without such metadata may hold anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from math import inf
from numbers import Real
from types import MappingProxyType
from typing import Any, Final, TypeAlias

from guard_api.errors import SpecError

Limit: TypeAlias = Mapping[str, Any]

_KEY: Final = "guard.limit"


def _limit(says: str, holds: Callable[[Any], bool]) -> Limit:
    return MappingProxyType({_KEY: (says, holds)})


def _real(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


FINITE: Final = _limit("a finite number", lambda x: _real(x) and -inf < x < inf)
POSITIVE: Final = _limit("a finite number above 0", lambda x: _real(x) and 0 < x < inf)
NOT_NEGATIVE: Final = _limit("a finite number of at least 0", lambda x: _real(x) and 0 <= x < inf)
THRESHOLD: Final = _limit("a number of at least 0", lambda x: _real(x) and x >= 0)
"""Also infinity: what lies beyond never happens."""


def whole(least: int, most: float = inf) -> Limit:
    """Return the limit of a whole number from `least` to `most`."""
    span = f"of at least {least}" if most == inf else f"from {least} to {most}"
    return _limit(f"a whole number {span}", lambda x: type(x) is int and least <= x <= most)


def check_limits(data: Any, name: str) -> None:
    """Raise SpecError for the first field of the dataclass `data`, called `name`, that is beyond its limit.

    Dataclasses in its fields are checked as well. None is allowed where it is the default.
    """
    if not is_dataclass(data) or isinstance(data, type):
        return
    for field in fields(data):
        value = getattr(data, field.name, None)
        says, holds = field.metadata.get(_KEY, ("", None))
        if holds and not holds(value) and not (value is None and field.default is None):
            raise SpecError(f"{name}.{field.name} is {value!r}: it must be {says}")
        check_limits(value, f"{name}.{field.name}")
