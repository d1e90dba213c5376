"""Friction and restitution in an engine that multiplies the values of two surfaces, where GUARD states them per pair.

Against what cannot move, a mover's own value counts; between two movers, the larger. With s on everything immovable and
value / s on a mover, the engine's products are

    mover on immovable = value                mover on mover = a b / s^2,

which is max(a, b) exactly when s^2 = min(a, b). So s^2 is chosen among the smaller values of the pairs that can meet,
such that most pairs come out right; the others are named as approximations.

The direct solver (see `guard_bullet.engine`) bounds friction along world x and y separately, mu N each: sliding at an
angle it reaches mu (|cos| + |sin|), 4 mu / pi on average over all directions. All its pairs are scaled by pi / 4.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Literal

from guard_api.model.robot import Link, RobotModel
from guard_api.scene.spec import SceneSpec
from guard_bullet.dominance import geared_joints
from guard_bullet.pairs import self_collides

Quantity = Literal["friction", "restitution"]

ROBOT_RESTITUTION = 0.0

PYRAMID = math.pi / 4.0
"""Scale of friction under the direct solver, which makes the mean over all directions right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mover:
    """Things that move and share one surface: `several` when two of them can meet each other."""

    name: str
    friction: float
    restitution: float
    several: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Surfaces:
    """The values s that everything immovable gets, for `friction` and for `restitution`.

    scale: by which the friction of all pairs is multiplied, included in `friction` by its root.
    """

    friction: float
    restitution: float
    scale: float = 1.0

    def of_mover(self, friction: float, restitution: float) -> tuple[float, float]:
        """Return the engine's friction and restitution of a mover with these values."""
        return self.scale * friction / self.friction, restitution / self.restitution


def surfaces(scene: SceneSpec) -> Surfaces:
    """Return the values of immovable surfaces that make most pairs of `scene` exact."""
    movers = _movers(scene)
    scale = PYRAMID if scene.robot and geared_joints(scene, scene.robot) else 1.0
    friction, restitution = _scale(movers, "friction"), _scale(movers, "restitution")
    return Surfaces(friction=math.sqrt(scale) * friction, restitution=restitution, scale=scale)


def approximations(scene: SceneSpec) -> tuple[str, ...]:
    """Return the pairs of movers whose values the engine gets wrong, one sentence each."""
    movers, chosen = _movers(scene), surfaces(scene)
    sentences = []
    if chosen.scale != 1.0:
        sentences.append(
            "friction is right on average over all directions, 21 % low along world x and y, 11 % high between"
        )
    friction = chosen.friction / math.sqrt(chosen.scale)
    for quantity, scale in (("friction", friction), ("restitution", chosen.restitution)):
        for a, b in _pairs(movers):
            x, y = getattr(a, quantity), getattr(b, quantity)
            got = x * y / scale**2
            if not math.isclose(got, max(x, y), rel_tol=1e-9):
                pair = f"between {a.name} and {b.name}" if a is not b else f"among {a.name}"
                sentences.append(f"contacts {pair} have {quantity} {got:g} (Bullet multiplies), not {max(x, y):g}")
    return tuple(sentences)


def link_friction(link: Link) -> float:
    """Return the one friction value of a link: the engine keeps it per link, not per shape."""
    return max((collision.friction for collision in link.collisions), default=0.0)


def _movers(scene: SceneSpec) -> list[Mover]:
    movers = [
        Mover(name=f"group {g.name!r}", friction=g.body.friction, restitution=g.body.restitution, several=g.count > 1)
        for g in scene.groups
        if g.body.physics == "dynamic" and g.count > 0
    ]
    return movers + (_robot_movers(scene.robot) if scene.robot else [])


def _robot_movers(robot: RobotModel) -> list[Mover]:
    """Return the robot's links by their friction."""
    names: dict[float, list[str]] = {}
    for link in robot.links:
        if link.collisions:
            names.setdefault(link_friction(link), []).append(link.name)
    several = self_collides(robot)
    return [
        Mover(name=f"links {', '.join(n)}", friction=mu, restitution=ROBOT_RESTITUTION, several=several)
        for mu, n in names.items()
    ]


def _pairs(movers: list[Mover]) -> list[tuple[Mover, Mover]]:
    return [
        (a, b)
        for i, a in enumerate(movers)
        for b in movers[i:]
        # Two links of one robot meet only if it collides with itself at all.
        if (a is not b and not (_is_link(a) and _is_link(b) and not a.several)) or (a is b and a.several)
    ]


def _is_link(mover: Mover) -> bool:
    return mover.name.startswith("links ")


def _scale(movers: list[Mover], quantity: Quantity) -> float:
    smaller = Counter(min(getattr(a, quantity), getattr(b, quantity)) for a, b in _pairs(movers))
    candidates = [value for value, _ in smaller.most_common() if value > 0.0]
    return math.sqrt(candidates[0]) if candidates else 1.0
