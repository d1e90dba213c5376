"""Who touches whom, and how: the scene's contact rule as a table of geom pairs.

MuJoCo usually derives a contact from its two geoms. GUARD states every pair instead: friction and restitution are then
exactly the scene's rule, and friction can have its own time constant, which a geom cannot.
"""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, TypeAlias

import mujoco

from guard_api.scene.spec import SceneSpec

Role: TypeAlias = Literal["ground", "static", "driven", "dynamic", "robot", "robot above ground", "robot base"]
Neighbours: TypeAlias = frozenset[frozenset[str]]

MOVING: frozenset[Role] = frozenset({"dynamic", "robot", "robot above ground"})

RIGID_IMPRATIO = 100.0
"""Friction this much stiffer than the normal direction: what should stick creeps at micrometres per second."""

RIGID_SOLIMP = (0.99, 0.99, 0.001, 0.5, 2.0)
"""Share of its target acceleration that a contact reaches, the same at any depth."""

RIGID_STIFFNESS = 0.04
"""Contact stiffness times timestep^2: a contact pushes this share of its depth out per step.

An impact is seen at most one step's way deep, so this is also the largest share of the impact speed that a contact
gives back beyond its restitution. Smaller lets bodies sink: to 1e-5 m under their own weight at 2 ms.
"""

FRICTION_TIME = 0.02
"""Time constant of friction [s] of what may slip for long, MuJoCo's own default.

MuJoCo solves friction as a convex problem, in which slip at speed v lifts a contact at 2 mu v timestep / FRICTION_TIME.
As stiff as the normal direction it would make a box that slides at 1 m/s hop by 1 cm.
"""

LIMB_FRICTION_STEPS = 2.0
"""Time constant of friction of limbs on what stands still, in timesteps: the shortest that MuJoCo allows.

A foot lands, pushes and leaves within a few timesteps. With `FRICTION_TIME` it would slip all the while.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """What a geom is made of: its name `geom`, the MuJoCo `body` it is on, `role`, own friction and restitution.

    limb: whether it belongs to a link that swings between limits, as legs do.
    """

    geom: str
    body: str
    role: Role
    limb: bool = False
    friction: float = 0.0
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


def stiffen_joint(joint: mujoco.MjsJoint, scene: SceneSpec) -> None:
    """Give joint limits and dry friction the preset's stiffness."""
    if scene.preset == "rigid":
        joint.solref_limit, joint.solimp_limit = _solref(scene, 0.0), RIGID_SOLIMP
        joint.solref_friction, joint.solimp_friction = _solref(scene, 0.0), RIGID_SOLIMP


def add_pairs(spec: mujoco.MjSpec, scene: SceneSpec, surfaces: Sequence[Surface], neighbours: Neighbours) -> None:
    """Add a pair for every two surfaces that collide; `neighbours` are the pairs of bodies joined by a joint."""
    for first, second in combinations(surfaces, 2):
        if not _collide(first, second, neighbours):
            continue
        moving = [surface for surface in (first, second) if surface.role in MOVING]
        friction = max(surface.friction for surface in moving)
        restitution = max(surface.restitution for surface in moving)
        pair = spec.add_pair(geomname1=first.geom, geomname2=second.geom, condim=3 if friction > 0.0 else 1)
        pair.friction = [friction, friction, 0.0, 0.0, 0.0]
        if scene.preset == "rigid":
            stiffest = LIMB_FRICTION_STEPS * scene.timestep
            limb = len(moving) == 1 and moving[0].limb
            pair.solreffriction = [stiffest if limb else max(FRICTION_TIME, stiffest), 1.0]
            pair.solimp = RIGID_SOLIMP
        if scene.preset == "rigid" or restitution > 0.0:
            pair.solref = _solref(scene, restitution)


def _collide(first: Surface, second: Surface, neighbours: Neighbours) -> bool:
    """Return whether two surfaces touch: at least one can give way, and no joint or common body keeps them apart."""
    roles = {first.role, second.role}
    if not roles & MOVING or roles == {"robot above ground", "ground"}:
        return False
    return first.body != second.body and frozenset((first.body, second.body)) not in neighbours


def _solref(scene: SceneSpec, restitution: float) -> list[float]:
    """Return stiffness and damping, negative as MuJoCo wants them, of a contact with `restitution`.

    A contact that meets at speed v aims at the acceleration -b v: with b = (1 + e) / timestep it parts at -e v one
    step later, which is Newton's law of restitution.
    """
    h = scene.timestep
    return [-RIGID_STIFFNESS / h**2, -(1.0 + restitution) / h]
