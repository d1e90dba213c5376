"""What MuJoCo holds for one world, in GUARD's axes and order."""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.physics.state import Inspection
from guard_mujoco.compile import NO_BODY, CompiledScene

Array = NDArray[np.float64]


def inspect(compiled: CompiledScene, model: mujoco.MjModel, data: mujoco.MjData) -> Inspection:
    """Return masses, inertias, mass matrix and bias force of `data`, which is a copy that may be computed on."""
    mujoco.mj_forward(model, data)
    num_links = len(compiled.link_body)
    mass, com, inertia = np.zeros(num_links), np.zeros((num_links, 3)), np.zeros((num_links, 3, 3))
    for link, body in enumerate(compiled.link_body):
        if body != NO_BODY:
            mass[link], com[link] = model.body_mass[body], model.body_ipos[body]
            R = rotations.to_matrix(model.body_iquat[body])
            inertia[link] = R @ np.diag(model.body_inertia[body]) @ R.T
    matrix, bias = _dynamics(compiled, model, data)
    body_mass = np.array(
        [
            model.body_mass[body] if spec.physics == "dynamic" else 0.0
            for spec, body in zip(compiled.scene.bodies, compiled.body_body, strict=True)
        ]
    )
    return Inspection(
        link_mass=mass,
        link_com=com,
        link_inertia=inertia,
        mass_matrix=matrix,
        bias_force=bias,
        body_mass=body_mass,
    )


def _dynamics(compiled: CompiledScene, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array]:
    """Return mass matrix (D, D) and bias force (D,) of the robot, base angular coordinates in world axes."""
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    base = np.arange(6 if compiled.base_free else 0)
    dofs = np.concatenate([base, compiled.joint_dof])
    matrix, bias = full[np.ix_(dofs, dofs)], data.qfrc_bias[dofs]
    if compiled.base_free:
        # MuJoCo's angular velocity is in body axes, w_body = R' w; as w x w = 0, accelerations turn the same way.
        T = np.eye(len(dofs))
        T[3:6, 3:6] = rotations.to_matrix(data.qpos[3:7]).T
        matrix, bias = T.T @ matrix @ T, T.T @ bias
    return matrix, bias
