"""Strict reading of TOML tables: every fault is reported with its key, and reading goes on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from guard_api.model.problems import LARGEST_NUMBER, Problems, did_you_mean


class Table:
    """One table of a file. Asking for a key makes it known; `finish` reports the keys that nothing asked for.

    A reader without a default reports an absent key and returns a stand-in.
    """

    def __init__(self, data: dict[str, Any], file: str, problems: Problems, prefix: str = "") -> None:
        self._data = data
        self._file = file
        self._prefix = prefix
        self._problems = problems
        self._known: set[str] = set()

    def __contains__(self, key: str) -> bool:
        self._known.add(key)
        return key in self._data

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def error(self, key: str, message: str) -> None:
        """Report that the robot cannot be used because of `key`."""
        self._problems.error(f"{self._file}: {self._prefix}{key}", message)

    def number(
        self, key: str, default: float | None = None, *, above: float = -math.inf, at_least: float = -math.inf
    ) -> float:
        """Return a finite number greater than `above` and not less than `at_least`."""
        value = self._get(key, default)
        if not _finite(value):
            return self._wrong(key, value, "a finite number", default, 1.0)
        if value <= above:
            self.error(key, f"{value!r} must be greater than {above:g}")
            return 1.0 if default is None else default
        if value < at_least:
            self.error(key, f"{value!r} must be at least {at_least:g}")
        return max(float(value), at_least)

    def integer(self, key: str, default: int, *, at_least: int) -> int:
        """Return a whole number."""
        value = self._get(key, default)
        if isinstance(value, bool) or not isinstance(value, int):
            return self._wrong(key, value, "a whole number", default, at_least)
        if value < at_least:
            self.error(key, f"{value!r} must be at least {at_least}")
        return max(value, at_least)

    def boolean(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._get(key, default)
        return value if isinstance(value, bool) else self._wrong(key, value, "true or false", default, False)

    def text(self, key: str, default: str | None = None, *, choices: tuple[str, ...] = ()) -> str:
        """Return a string, one of `choices` if there are any."""
        value = self._get(key, default)
        if not isinstance(value, str) or (not value and default is None):
            return self._wrong(key, value, "a text", default, choices[0] if choices else "")
        if choices and value not in choices:
            self.error(key, f"unknown value {value!r}: {did_you_mean(value, choices)}")
            return choices[0]
        return value

    def vector(self, key: str, size: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """Return `size` finite numbers."""
        value = self._get(key, default)
        numbers = isinstance(value, list | tuple) and all(map(_finite, value))
        if not numbers or len(value) != size:
            return self._wrong(key, value, f"a list of {size} finite numbers", default, (1.0,) * size)
        return tuple(float(item) for item in value)

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings, empty when absent."""
        value = self._get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            return self._wrong(key, value, "a list of texts", (), ())
        return tuple(value)

    def table(self, key: str) -> Table:
        """Return the table at `key`, an empty one when absent."""
        value = self._get(key, {})
        if not isinstance(value, dict):
            value = self._wrong(key, value, "a table", {}, {})
        return Table(value, self._file, self._problems, f"{self._prefix}{key}.")

    def tables(self, key: str) -> list[Table]:
        """Return the array of tables at `key`, empty when absent."""
        value = self._get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            value = self._wrong(key, value, "an array of tables", [], [])
        prefix = f"{self._prefix}{key}"
        return [Table(item, self._file, self._problems, f"{prefix}[{i}].") for i, item in enumerate(value)]

    def finish(self) -> None:
        """Report every key that no reader asked for, with the nearest one that means something."""
        for key in self._data:
            if key not in self._known:
                self.error(key, f"unknown key: {did_you_mean(key, sorted(self._known))}")

    def _get(self, key: str, default: Any) -> Any:
        self._known.add(key)
        return self._data.get(key, default)

    def _wrong(self, key: str, value: Any, wanted: str, default: Any, stand_in: Any) -> Any:
        if key in self._data:
            self.error(key, f"{value!r} is not {wanted}")
        else:
            self.error(key, f"is missing: give {wanted}")
        return stand_in if default is None else default


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_NUMBER
