"""Plain data (JSON, TOML) into dataclasses by their type hints; every fault is collected, with its key."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from types import NoneType, UnionType
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from guard_api.errors import SpecError, unknown_name

T = TypeVar("T")

UNLIMITED: Final = "unlimited"
"""What stands for infinity in JSON."""

_LARGEST: Final = 1e300
"""Magnitude beyond which a number is refused, unless it is infinity."""

_SCALARS: Final[dict[type, str]] = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


class Reader:
    """Reads values by their types and collects what is wrong with them in `faults`, one line each.

    variants: protocol -> function that returns the dataclass of a name; tables of such a type have a key `type`.
    """

    def __init__(self, variants: Mapping[Any, Callable[[str], Any]]) -> None:
        self.faults: list[str] = []
        self._variants = variants

    def read(self, kind: type[T], data: Any, key: str = "") -> T | None:
        """Return the dataclass `kind` made from the table `data` that stands at `key`, or None after a fault."""
        if not isinstance(data, Mapping):
            return self._fault(key, f"{data!r} is not a table of {kind.__name__}")
        before, hints = len(self.faults), get_type_hints(kind)
        known = {field.name: field for field in dataclasses.fields(kind) if field.init}  # type: ignore[arg-type]
        prefix = f"{key}." if key else ""
        for name in data:
            if name not in known:
                self._fault(f"{prefix}{name}", str(unknown_name("key", name, known)))
        for name, field in known.items():
            if name not in data and field.default is field.default_factory is dataclasses.MISSING:
                self._fault(f"{prefix}{name}", "is missing")
        values = {name: self._value(hints[name], data[name], f"{prefix}{name}") for name in known if name in data}
        return kind(**values) if len(self.faults) == before else None

    def _value(self, hint: Any, value: Any, key: str) -> Any:
        """Return `value`, which stands at `key`, as the type `hint`."""
        if hint in self._variants:
            return self._variant(hint, value, key)
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            return self.read(hint, value, key)
        of_origin = {
            Union: self._either, UnionType: self._either, tuple: self._tuple, dict: self._dict, Literal: self._choice,
        }.get(get_origin(hint))  # fmt: skip
        if of_origin is not None:
            return of_origin(get_args(hint), value, key)
        return self._scalar(hint, value, key) if hint in _SCALARS else _as_tuple(value)

    def _variant(self, hint: Any, value: Any, key: str) -> Any:
        if not isinstance(value, Mapping) or not isinstance(value.get("type"), str):
            return self._fault(key, f"{value!r} is not a table with a key 'type'")
        try:
            kind = self._variants[hint](value["type"])
        except SpecError as error:
            return self._fault(f"{key}.type", str(error))
        return self.read(kind, {name: item for name, item in value.items() if name != "type"}, key)

    def _either(self, hints: tuple[Any, ...], value: Any, key: str) -> Any:
        """Return `value` as the first of `hints` that it fits; otherwise the faults are those of the first."""
        if value is None and NoneType in hints:
            return None
        hints = tuple(hint for hint in hints if hint is not NoneType)
        before = len(self.faults)
        for hint in (*hints, hints[0]):
            del self.faults[before:]
            result = self._value(hint, value, key)
            if len(self.faults) == before:
                return result
        return None

    def _tuple(self, hints: tuple[Any, ...], value: Any, key: str) -> Any:
        if not isinstance(value, list | tuple):
            return self._fault(key, f"{value!r} is not a list")
        if len(hints) == 2 and hints[1] is Ellipsis:
            hints = (hints[0],) * len(value)
        if len(value) != len(hints):
            return self._fault(key, f"{list(value)!r} has {len(value)} entries: expected {len(hints)}")
        items = zip(hints, value, strict=True)
        return tuple(self._value(hint, item, f"{key}[{i}]") for i, (hint, item) in enumerate(items))

    def _dict(self, hints: tuple[Any, ...], value: Any, key: str) -> Any:
        if not isinstance(value, Mapping):
            return self._fault(key, f"{value!r} is not a table")
        return {name: self._value(hints[1], item, f"{key}.{name}") for name, item in value.items()}

    def _choice(self, choices: tuple[Any, ...], value: Any, key: str) -> Any:
        if value in choices:
            return value
        return self._fault(key, str(unknown_name("value", str(value), map(str, choices))))

    def _scalar(self, hint: type, value: Any, key: str) -> Any:
        if hint is float:
            if value == UNLIMITED:
                return math.inf
            fits = isinstance(value, int | float) and not isinstance(value, bool) and value >= -_LARGEST
            return (
                float(value)
                if fits and (value <= _LARGEST or value == math.inf)
                else self._fault(key, f"{value!r} is not {_SCALARS[hint]}")
            )
        return value if type(value) is hint else self._fault(key, f"{value!r} is not {_SCALARS[hint]}")

    def _fault(self, key: str, message: str) -> None:
        self.faults.append(f"{key}: {message}" if key else message)


def plain(value: Any) -> Any:
    """Return JSON data without the infinities that JSON does not have, and with lists for tuples."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return UNLIMITED if value == math.inf else value


def _as_tuple(value: Any) -> Any:
    """Return a value of unknown type, with tuples for lists: dataclasses of specifications are compared."""
    if value == UNLIMITED:
        return math.inf
    return tuple(_as_tuple(item) for item in value) if isinstance(value, list | tuple) else value
