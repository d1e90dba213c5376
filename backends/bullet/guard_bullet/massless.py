"""Massless links that the engine cannot hold: they get a token of mass and inertia.

A joint's acceleration divides by the inertia about its axis of what it moves, the joints further out giving way. Behind
a massless link that is nothing once a joint further out turns about the same axis: two hinges in line, as Hopper's
hip and thigh have, or three at right angles whose middle one is turned by 90 degrees. A robot's armature keeps its
equations regular there; the engine, which has none (`guard_bullet.passive`), would divide by rounding errors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guard_api.model.robot import PLANAR_JOINTS, Joint, Link, RobotModel

TOKEN = 1e-9
"""Mass and inertia of a token, in shares of the robot's mass and of the largest moment of inertia of its links."""


def held_links(robot: RobotModel) -> tuple[Link, ...]:
    """Return the links of `robot` as the engine holds them: `token_links` with their token."""
    tokens = token_links(robot)
    mass = TOKEN * sum(link.mass for link in robot.links)
    moment = TOKEN * max(float(np.linalg.eigvalsh(link.inertia).max()) for link in robot.links)
    inertia = ((moment, 0.0, 0.0), (0.0, moment, 0.0), (0.0, 0.0, moment))
    return tuple(replace(link, mass=mass, inertia=inertia) if link.name in tokens else link for link in robot.links)


def token_links(robot: RobotModel) -> list[str]:
    """Return the names of the massless links whose joint can fall in line with one further out, before any mass.

    Only joints of one kind can. The sliders and the hinge of a planar base are at right angles for ever.
    """
    return [
        joint.child
        for joint in robot.joints
        if joint.name not in PLANAR_JOINTS and _falls_in_line([j.kind == "prismatic" for j in _to_mass(robot, joint)])
    ]


def _falls_in_line(slides: list[bool]) -> bool:
    return slides.count(True) > 1 or slides.count(False) > 1


def _to_mass(robot: RobotModel, joint: Joint) -> list[Joint]:
    """Return `joint` and, if it carries a massless link, the joints further out up to those that carry mass."""
    if not robot.links[robot.link_index(joint.child)].virtual:
        return [joint]
    carried = [further for further in robot.joints if further.parent == joint.child]
    return [joint, *(found for further in carried for found in _to_mass(robot, further))]
