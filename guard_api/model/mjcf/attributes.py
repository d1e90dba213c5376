"""Attributes of MJCF that are not plain numbers: lists of varying length, flags and choices."""

from __future__ import annotations

import copy
from collections.abc import Sequence

from guard_api.model.element import Element
from guard_api.model.problems import did_you_mean


def extended(node: Element, attributes: dict[str, str]) -> Element:
    """Return `node` with further `attributes` where it has none of its own."""
    whole = copy.copy(node)
    whole.attributes = attributes | node.attributes
    return whole


def numbers(node: Element, name: str, least: int, most: int, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return the `least` to `most` finite numbers in attribute `name`; `default` when it is absent or faulty."""
    count = len(node.attributes.get(name, "").split())
    if name in node.attributes and not least <= count <= most:
        node.error(f"<{node.tag}> {name}={node.attributes[name]!r} has {count} numbers instead of {least} to {most}")
        return default
    return node.vector(name, count, default) if name in node.attributes else default


def not_negative(node: Element, name: str, default: float = 0.0) -> float:
    """Return the number in attribute `name`, reported if it is negative."""
    value = node.number(name, default)
    if value < 0.0:
        node.error(f"<{node.tag}> {name} {value:g} must not be negative")
        return default
    return value


def choice(node: Element, name: str, default: str, known: Sequence[str]) -> str:
    """Return the word in attribute `name`, one of `known`."""
    word = node.attributes.get(name, default).strip()
    if word in known:
        return word
    node.error(f"<{node.tag}> {name}={word!r}: {did_you_mean(word, known)}")
    return default


def flag(node: Element, name: str, default: bool) -> bool:
    """Return whether attribute `name` is "true"."""
    return choice(node, name, "true" if default else "false", ("true", "false")) == "true"


def limited(node: Element, key: str, bounds: str, automatic: bool) -> bool:
    """Return whether the range in attribute `bounds` is in force, which attribute `key` says or its presence means.

    Reports a range that nothing switches on, and one that is switched on and absent.
    """
    stated = choice(node, key, "auto", ("auto", "true", "false"))
    given = bounds in node.attributes
    if stated == "auto" and given and not automatic:
        node.error(f'<{node.tag}> has {bounds} but not {key}: say {key}="true" or "false" where autolimits is off')
    if stated == "true" and not given:
        node.error(f'<{node.tag}> has {key}="true" but no {bounds}: add it')
    return given and stated != "false"


def increasing(node: Element, name: str) -> tuple[float, float]:
    """Return the two numbers in attribute `name`, reported unless the first is less."""
    lower, upper = node.vector(name, 2, (0.0, 1.0))
    if lower >= upper:
        node.error(f"<{node.tag}> {name} {lower:g} {upper:g} must be increasing")
    return lower, upper


def symmetric_bound(node: Element, name: str) -> float:
    """Return the one bound b of a range -b, b in attribute `name`; other ranges are reported."""
    lower, upper = node.vector(name, 2, (-1.0, 1.0))
    if upper <= 0.0 or lower != -upper:
        node.error(f"<{node.tag}> {name} {lower:g} {upper:g}: only a symmetric range, such as -1 1, is supported")
        return 1.0
    return upper
