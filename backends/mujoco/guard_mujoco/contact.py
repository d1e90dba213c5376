"""Who touches whom, and how: collision bits, friction, stiffness and restitution, as MuJoCo can say them.

The scene's rule (the moving body's own friction against ground, static and driven bodies, the larger of two moving
ones) is MuJoCo's maximum once ground, static and driven geoms have friction 0: the stiffness parameters of two geoms
are averaged independently of friction, and here they are equal. Bodies with restitution get explicit pairs.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal, TypeAlias

import mujoco

from guard_api.scene.spec import SceneSpec

Role: TypeAlias = Literal["ground", "static", "driven", "dynamic", "robot", "robot above ground", "robot base"]

_GROUND, _IMMOVABLE, _MOVING = 1, 2, 4

COLLISION_BITS: dict[Role, tuple[int, int]] = {
    "ground": (_GROUND, 0),
    "static": (_IMMOVABLE, 0),
    "driven": (_IMMOVABLE, 0),
    "dynamic": (_MOVING, _GROUND | _IMMOVABLE | _MOVING),
    "robot": (_MOVING, _GROUND | _IMMOVABLE | _MOVING),
    "robot above ground": (_MOVING, _IMMOVABLE | _MOVING),
    "robot base": (_MOVING, _MOVING),
}
"""Role -> (contype, conaffinity). What cannot give way touches nothing else that cannot give way."""

MOVING: frozenset[Role] = frozenset({"dynamic", "robot", "robot above ground"})

RIGID_SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)
RIGID_IMPRATIO = 100.0

BOUNCE_STIFFNESS = 0.01
"""Spring of a bouncing contact times timestep^2: it may add 1 % of the impact speed to the rebound, and no more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """What a geom is made of: its `geom` name, `role`, own `friction` and `restitution`."""

    geom: str
    role: Role
    friction: float
    restitution: float = 0.0


def set_options(spec: mujoco.MjSpec, scene: SceneSpec) -> None:
    """Set timestep, gravity, the integrator of GUARD's actuation law and the contact preset."""
    option = spec.option
    option.timestep = scene.timestep
    option.gravity = list(scene.gravity)
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    # On a non-finite number the engine would jump back to the initial state without telling anyone.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if scene.preset == "rigid":
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = RIGID_IMPRATIO


def set_surface(geom: mujoco.MjsGeom, surface: Surface, scene: SceneSpec) -> None:
    """Set collision bits, friction and the preset's stiffness of `geom`."""
    geom.name = surface.geom
    geom.contype, geom.conaffinity = COLLISION_BITS[surface.role]
    geom.condim = 3
    geom.friction = [surface.friction if surface.role in MOVING else 0.0, 0.0, 0.0]
    if scene.preset == "rigid":
        geom.solref, geom.solimp = _rigid_solref(scene), RIGID_SOLIMP


def stiffen_joint(joint: mujoco.MjsJoint, scene: SceneSpec) -> None:
    """Give joint limits and dry friction the preset's stiffness."""
    if scene.preset == "rigid":
        joint.solref_limit, joint.solimp_limit = _rigid_solref(scene), RIGID_SOLIMP
        joint.solref_friction, joint.solimp_friction = _rigid_solref(scene), RIGID_SOLIMP


def add_restitution(spec: mujoco.MjSpec, surfaces: list[Surface], scene: SceneSpec) -> None:
    """Add an explicit pair for every two geoms of which one bounces.

    A contact that sees the approach velocity v and aims at the acceleration -b v leaves with v (1 - b timestep): the
    damping b = (1 + e) / timestep is Newton's restitution e in one step. Pairs, not geoms, because a geom's solref
    would act on friction as well and turn the tangential velocity around.
    """
    for first, second in combinations(surfaces, 2):
        restitution, friction = _combined(first, second)
        if restitution == 0.0 or not _collide(first.role, second.role):
            continue
        pair = spec.add_pair(geomname1=first.geom, geomname2=second.geom, condim=3)
        pair.friction = [friction, friction, 0.0, 0.0, 0.0]
        h = scene.timestep
        pair.solref = [-BOUNCE_STIFFNESS / h**2, -(1.0 + restitution) / h]
        if scene.preset == "rigid":
            pair.solreffriction, pair.solimp = _rigid_solref(scene), RIGID_SOLIMP


def _combined(first: Surface, second: Surface) -> tuple[float, float]:
    """Return restitution and friction of a contact by the scene's rule."""
    moving = [surface for surface in (first, second) if surface.role in MOVING]
    if not moving:
        return 0.0, 0.0
    return max(surface.restitution for surface in moving), max(surface.friction for surface in moving)


def _collide(first: Role, second: Role) -> bool:
    (type1, affinity1), (type2, affinity2) = COLLISION_BITS[first], COLLISION_BITS[second]
    return bool(type1 & affinity2 or type2 & affinity1)


def _rigid_solref(scene: SceneSpec) -> list[float]:
    # The stiffest contact that the engine integrates stably: a time constant of two timesteps, critically damped.
    return [2.0 * scene.timestep, 1.0]
