"""One friction value per pair: PhysX averages the materials of two shapes, GUARD has a rule of its own.

GUARD (`guard_api.scene.spec`): against the ground, a static or a driven body the moving body's own coefficient; between
two moving bodies the larger one. An average equals a wanted value when both sides carry that very value. So every shape
exists once per *facing*: a material and the collision bits of the partners that carry the same one. Scenes where all
friction values are equal, the usual case, need a single facing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TypeAlias

from guard_api.scene.spec import SceneSpec

Material: TypeAlias = tuple[float, float]
"""Friction and restitution."""

SAPIEN_MATERIAL: Material = (0.3, 0.1)
"""SAPIEN's default material, which the preset "native" gives to the ground; its restitution also to robots."""

_COLLISION_BITS = 32


@dataclass(frozen=True, slots=True, order=True)
class Surface:
    """What decides the contacts of a moving shape: its own `material` and whether it collides with the ground."""

    material: Material
    on_ground: bool


@dataclass(frozen=True, slots=True)
class Facing:
    """One copy of a shape: it meets the shapes that share a bit of `bits`, with `material` on both sides."""

    material: Material
    bits: int


class ContactTable:
    """The facings of every shape of a scene. `exact` is False where PhysX's average is left to decide."""

    def __init__(self, scene: SceneSpec) -> None:
        self._surfaces = _moving_surfaces(scene)
        count = len(self._surfaces)
        fits = count * (count + 3) // 2 <= _COLLISION_BITS
        self.exact = scene.preset == "rigid" and fits
        self.approximations: tuple[str, ...] = ()
        if scene.preset == "rigid" and not fits:
            self.approximations = (
                f"friction of a pair is the mean of both, not GUARD's rule: PhysX can tell 6 moving materials apart, "
                f"this scene has {count}",
            )
        pairs = list(combinations_with_replacement(range(count), 2))
        self._pair_bit = {pair: 1 << i for i, pair in enumerate(pairs)}
        self._fixed_bit = [1 << (len(pairs) + i) for i in range(count)]

    def moving(self, material: Material, on_ground: bool = True) -> list[Facing]:
        """Return the facings of a shape of the robot or of a dynamic body."""
        if not self.exact:
            return [Facing(material, 0b11 if on_ground else 0b01)]
        me = self._surfaces.index(Surface(material, on_ground))
        bits: dict[Material, int] = {material: self._fixed_bit[me]}
        for (i, j), bit in self._pair_bit.items():
            if me in (i, j):
                shared = _larger(self._surfaces[i].material, self._surfaces[j].material)
                bits[shared] = bits.get(shared, 0) | bit
        return [Facing(shared, bit) for shared, bit in bits.items()]

    def fixed(self, material: Material) -> list[Facing]:
        """Return the facings of a static or driven body, of whose `material` only the "native" preset takes notice."""
        if not self.exact:
            return [Facing(material, 0b01)]
        return _merged([(s.material, bit) for s, bit in zip(self._surfaces, self._fixed_bit, strict=True)])

    def ground(self) -> list[Facing]:
        """Return the facings of the ground plane."""
        if not self.exact:
            return [Facing(SAPIEN_MATERIAL, 0b10)]
        bits = zip(self._surfaces, self._fixed_bit, strict=True)
        return _merged([(surface.material, bit) for surface, bit in bits if surface.on_ground])


def robot_material(scene: SceneSpec, friction: float) -> Material:
    """Return the material of a robot shape: robots do not bounce, except with SAPIEN's own default in "native"."""
    return (friction, SAPIEN_MATERIAL[1] if scene.preset == "native" else 0.0)


def _moving_surfaces(scene: SceneSpec) -> list[Surface]:
    """Return the distinct surfaces of everything that moves, sorted."""
    found = {Surface((b.friction, b.restitution), True) for b in scene.bodies if b.physics == "dynamic"}
    if scene.robot is not None:
        collisions = [c for link in scene.robot.links for c in link.collisions]
        found |= {Surface(robot_material(scene, c.friction), scene.robot.collide_ground) for c in collisions}
    return sorted(found)


def _merged(facings: list[tuple[Material, int]]) -> list[Facing]:
    bits: dict[Material, int] = {}
    for material, bit in facings:
        bits[material] = bits.get(material, 0) | bit
    return [Facing(material, bit) for material, bit in bits.items()]


def _larger(a: Material, b: Material) -> Material:
    return (max(a[0], b[0]), max(a[1], b[1]))
