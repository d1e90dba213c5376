"""What PhysX holds for one world, for the conformance suite and the doctor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.robot import RobotModel
from guard_api.physics.state import Array, Inspection
from guard_api.scene.spec import SceneSpec
from guard_sapien.compile import Copy
from guard_sapien.engine import physx


def inspect_copy(spec: SceneSpec, copy: Copy, of_model: NDArray[np.intp] | None) -> Inspection:
    """Return the engine's numbers of one world. of_model: (J,) PhysX's number of every model joint."""
    links = copy.robot.links if copy.robot else ()
    matrix = bias = None
    if copy.robot is not None and spec.robot is not None and not spec.robot.floating and of_model is not None:
        matrix, bias = _dynamics(spec, spec.robot, copy.robot.engine, of_model)
    return Inspection(
        link_mass=np.array([link.mass for link in links], float),
        link_com=np.array([link.cmass_local_pose.p for link in links], float).reshape(-1, 3),
        link_inertia=np.array([_inertia(link) for link in links]).reshape(-1, 3, 3),
        mass_matrix=matrix,
        bias_force=bias,
        body_mass=np.array(
            [
                getattr(c, "mass", 0.0) if b.physics == "dynamic" else 0.0
                for c, b in zip(copy.bodies, spec.bodies, strict=True)
            ],
            float,
        ),
    )


def _dynamics(
    spec: SceneSpec, robot: RobotModel, engine: physx.PhysxArticulation, of_model: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return mass matrix (J, J), armature included, and bias force (J,) of a welded robot, in the model's order."""
    if not robot.joints:
        return np.zeros((0, 0)), np.zeros(0)
    gravity = list(spec.gravity)
    pinocchio = physx.PhysxArticulation.create_pinocchio_model(engine, gravity)
    matrix = np.asarray(pinocchio.compute_generalized_mass_matrix(engine.get_qpos()), float)
    matrix = matrix[np.ix_(of_model, of_model)]
    # The engine's armature holds the implicit damping h D on top of the model's; see `articulation`.
    held = np.array([joint.get_armature()[0] for joint in engine.active_joints], float)[of_model]
    implicit = spec.timestep * np.array([joint.damping for joint in robot.joints])
    bias = np.asarray(engine.compute_passive_force(gravity=True, coriolis_and_centrifugal=True), float)[of_model]
    return matrix + np.diag(held - implicit), bias


def _inertia(link: physx.PhysxArticulationLinkComponent) -> Array:
    """Return the inertia (3, 3) about the com in link axes."""
    R = rotations.to_matrix(np.asarray(link.cmass_local_pose.q, float))
    return R @ np.diag(np.asarray(link.inertia, float)) @ R.T
