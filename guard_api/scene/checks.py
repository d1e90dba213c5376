"""What an environment may ask for: placements that mean something, or one SpecError that names the field."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Final

from guard_api.errors import SpecError
from guard_api.scene.spec import BodyGroup, Placement

ROBOT: Final = ("rectangles", "locations", "radius")
"""The fields of a placement that say something of the robot itself."""


_MOST: Final = 1000
"""Things in a scene: the memory that placing them takes grows with their square."""


def check_groups(groups: Sequence[BodyGroup], robot: Placement) -> None:
    """Raise SpecError for the first count or placement that means nothing, naming the group and the field."""
    names = [group.name for group in groups]
    for name in names:
        if names.count(name) > 1:
            raise SpecError(f"two parts place {name!r}: each may appear once")
    for group in groups:
        if type(group.count) is not int or group.count < 0:
            raise SpecError(f"{group.name}: count is {group.count!r}: it must be a whole number of at least 0")
    total = sum(group.count for group in groups)
    if total > _MOST:
        most = max(groups, key=lambda group: group.count)
        raise SpecError(f"{most.name}: count is {most.count}: a scene may hold {_MOST} things in all, not {total}")
    for group in groups:
        for problem in _problems(group.placement, group.count):
            raise SpecError(f"{group.name}: {problem}")
        _check_onto(group, groups)
    default = Placement()
    for field in fields(Placement):
        if field.name not in ROBOT and getattr(robot, field.name) != getattr(default, field.name):
            raise SpecError(f"robot_placement.{field.name}: says nothing of the robot: it may have {', '.join(ROBOT)}")
    for problem in _problems(robot, 1):
        raise SpecError(f"robot_placement.{problem}")


def check_extents(extents: Sequence[float]) -> None:
    """Raise SpecError unless `extents` are (xmin, ymin, xmax, ymax)."""
    if not _is_rectangle(extents):
        raise SpecError(f"extents: {extents} are not (xmin, ymin, xmax, ymax)")


def _problems(placement: Placement, count: int) -> Iterator[str]:
    for rectangle in placement.rectangles:
        if not _is_rectangle(rectangle):
            yield f"rectangles: {rectangle} is not (xmin, ymin, xmax, ymax)"
    for location in placement.locations:
        if not _are_numbers(location, 2):
            yield f"locations: {location} is not (x, y)"
    if len(placement.locations) > count:
        yield f"locations: {len(placement.locations)} of them for {count}: raise the count or leave some out"
    if not (_are_numbers(placement.radius, 2, infinite=True) and 0 <= placement.radius[0] <= placement.radius[1]):
        yield f"radius: {placement.radius} is not (least, most) [m]"
    for name in ("distance", "clearance", "apart"):
        value = getattr(placement, name)
        if not (_are_numbers((value,), 1, infinite=name == "distance") and value >= 0):
            yield f"{name}: {value!r} must be a number of at least 0 [m]"
    heights = placement.heights
    if heights is not None and not (_are_numbers(heights, 2) and heights[0] <= heights[1]):
        yield f"heights: {heights} is not (low, high) [m]"


def _check_onto(group: BodyGroup, groups: Sequence[BodyGroup]) -> None:
    """Raise SpecError when `group` stands on bodies that there are not, too few of, or that stand on others."""
    onto = group.placement.onto
    if onto is None:
        return
    below = next((other for other in groups if other.name == onto), None)
    if below is None:
        raise SpecError(f"{group.name}: onto: nothing places {onto!r}: add the constraint {onto.capitalize()}")
    if below.placement.onto is not None:
        raise SpecError(f"{group.name}: onto: {onto!r} stand on others themselves")
    if below.count < group.count:
        raise SpecError(f"{group.name}: onto: {below.count} {onto} are too few for {group.count} {group.name}")


def _is_rectangle(value: Sequence[float]) -> bool:
    return _are_numbers(value, 4) and value[0] < value[2] and value[1] < value[3]


def _are_numbers(value: object, count: int, *, infinite: bool = False) -> bool:
    """Return whether `value` holds `count` numbers, none of them NaN, nor infinite unless `infinite`."""
    if not isinstance(value, list | tuple) or len(value) != count:
        return False
    real = all(isinstance(x, int | float) and not isinstance(x, bool) for x in value)
    return real and all(not math.isnan(x) and (infinite or math.isfinite(x)) for x in value)
