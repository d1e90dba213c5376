"""C3 with contacts: collision shapes are as large as the model says, and where the links are.

The other checks of C3 read what a world reports; these find where its engine really has things, by touching them.
"""

# ruff: noqa: D401 - the first line of a check is the promise that it tests

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import Collision, RobotModel
from guard_api.physics.backend import Backend
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Pose, Shape, Sphere
from guard_api.testing.checks.check import Finding, check, count, error
from guard_api.testing.scenes import WEIGHTLESS, bodies_scene, body, idle, one_joint, running

Array = NDArray[np.float64]

CORNERS = np.array(list(product((-0.1, 0.1), (-0.15, 0.15), (-0.2, 0.2))))

SHAPES: dict[str, tuple[Shape, list[tuple[float, float, float]]]] = {
    "sphere": (Sphere(radius=0.1), [(0.1, 0, 0), (0, -0.1, 0), (0, 0, 0.1)]),
    "box": (Box(half_extents=(0.1, 0.15, 0.2)), [(0.1, 0.05, 0.1), (0.05, -0.15, 0), (0, 0, 0.2)]),
    "cylinder": (Cylinder(radius=0.1, half_length=0.2), [(0.1, 0, 0.1), (0, -0.1, -0.1), (0.0, 0, 0.2)]),
    "capsule": (Capsule(radius=0.1, half_length=0.2), [(0.1, 0, 0.15), (0, -0.1, 0), (0, 0, 0.3)]),
    "mesh": (Mesh(vertices=tuple((float(x), float(y), float(z)) for x, y, z in CORNERS), source="corners of a box"),
             [(0.1, 0.05, 0.1), (0.05, -0.15, 0), (0, 0, 0.2)]),
}  # fmt: skip
"""Each shape with three points of its surface, where the outward normals are `NORMALS`."""

NORMALS = np.array([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)])

PROBE = 0.03
"""Radius of the balls that feel for surfaces [m]."""

FEEL = 0.003
"""Depth and distance [m] at which a probe must and must not touch: a convex hull approximates a round shape better."""


@check("C3", contacts=True)
def link_shapes(backend: Backend) -> list[Finding]:
    """Static balls 3 mm inside and 3 mm off the surface of a link's shape touch it, and do not."""
    findings = []
    for name, (shape, points) in SHAPES.items():
        turn = np.array([0.5, -0.1, 0.7, 0.5]) / np.linalg.norm([0.5, -0.1, 0.7, 0.5])
        w, x, y, z = turn.tolist()
        mount = Pose(position=(0.2, -0.1, 0.3), quaternion=(w, x, y, z))
        robot = one_joint("continuous", axis=(0.0, 0.6, 0.8), collisions=(Collision(shape=shape, pose=mount),))
        angle = np.full((1, 1), 0.7)
        poses = Kinematics(robot, ["tip"]).poses(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), angle)
        frame = rotations.multiply(poses.quaternion[0, 0], turn)
        centre = poses.position[0, 0] + rotations.rotate(poses.quaternion[0, 0], mount.position)
        inside, outside = (
            centre + rotations.rotate(frame, np.array(points) + (PROBE + gap) * NORMALS) for gap in (-FEEL, FEEL)
        )
        findings += [
            count(f"probes 3 mm inside a {name} not felt", int((~_felt(backend, robot, angle, inside)).sum())),
            count(f"probes 3 mm off a {name} felt", int(_felt(backend, robot, angle, outside).sum())),
        ]
    return findings


def _felt(backend: Backend, robot: RobotModel, angle: Array, places: Array) -> NDArray[np.bool_]:
    """Return which of the probes at `places` (P, 3) the robot touches."""
    probes = ("probes", body("static", half=PROBE, sphere=True), len(places))
    scene = bodies_scene(probes, robot=robot, gravity=WEIGHTLESS, ground=False)
    with running(backend, scene, joint_position=angle, body_position=places) as world:
        world.step(idle(world), 1)
        return world.state().body_contact[0]


@check("C3", contacts=True)
def body_shapes(backend: Backend) -> list[Finding]:
    """Bodies of every shape stand on the floor at the height of their lowest point, and lean on nothing."""
    heights = {"sphere": 0.1, "box": 0.2, "cylinder": 0.2, "capsule": 0.3, "mesh": 0.2}
    groups = [(name, body(shape=shape), 1) for name, (shape, _) in SHAPES.items()]
    place = [(1.0 * i, 0.0, height) for i, height in enumerate(heights.values())]
    with running(backend, bodies_scene(*groups), body_position=place) as world:
        # 0.1 s: a capsule balances on its end so long.
        world.step(idle(world), 50)
        position = world.state().body_position[0]
    return [error(f"place of a {name}", position[i], place[i], 1e-3, "m") for i, name in enumerate(heights)]
