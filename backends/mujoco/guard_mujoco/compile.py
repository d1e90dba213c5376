"""SceneSpec -> MjModel, and where in MuJoCo's arrays everything of the scene lies."""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from guard_api.errors import BackendError
from guard_api.model.inertia import as_vector, of_shape
from guard_api.scene.spec import BodySpec, SceneSpec
from guard_api.shapes import Mesh, Pose
from guard_mujoco.contact import Surface, add_pairs, set_options
from guard_mujoco.robot import FREE_JOINT, add_robot, joint_name, link_body, neighbours
from guard_mujoco.sensors import ContactReadout, add_contact_sensors, contact_readout, touch_approximations
from guard_mujoco.shapes import add_geom, set_inertia

Indices = NDArray[np.intp]

DRIVEN_INERTIA = 1e6
"""Mass of a driven body in multiples of everything that moves: what it loses to a push in one step is below 1e-6."""

NO_BODY = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledScene:
    """A scene, its model, and the places of its things in MuJoCo's arrays.

    link_body: (L,) MuJoCo body of every link, NO_BODY for massless links inside a chain. body_body: (B,) likewise.
    joint_qpos, joint_dof: (J,) place of every joint in qpos and qvel.
    base_free: whether qpos[:7], qvel[:6] are the base; base_mocap: its mocap index, or None.
    free: (F,) indices of the bodies that have a free joint, dynamic and driven; free_qpos (F,), free_dof (F,): its
    first place in qpos and qvel. driven: (D,) indices into `free`. fixed: (S,) indices of the static bodies;
    fixed_mocap (S,): their mocap indices.
    contact: how contact sensors become touch and body_contact.
    """

    scene: SceneSpec
    model: mujoco.MjModel
    link_body: Indices
    body_body: Indices
    joint_qpos: Indices
    joint_dof: Indices
    base_free: bool
    base_mocap: int | None
    free: Indices
    free_qpos: Indices
    free_dof: Indices
    driven: Indices
    fixed: Indices
    fixed_mocap: Indices
    contact: ContactReadout

    @property
    def own_dofs(self) -> NDArray[np.bool_]:
        """Places in qvel (nv,) of what moves by itself: all but driven bodies."""
        own = np.ones(self.model.nv, bool)
        for dof in self.free_dof[self.driven]:
            own[dof : dof + 6] = False
        return own

    @property
    def approximations(self) -> tuple[str, ...]:
        """What of the scene MuJoCo does not express exactly."""
        robot = self.scene.robot
        notes = touch_approximations(robot) if robot else []
        if len(self.driven):
            notes.append(f"driven bodies: their mass is {DRIVEN_INERTIA:g} times that of all that moves, not infinite")
        for group in self.scene.groups:
            if group.body.damping > 0.0 and isinstance(group.body.shape, Mesh):
                notes.append(f"group {group.name!r}: its spin is damped as if the body's axes were principal ones")
        return tuple(notes)


def compile_scene(scene: SceneSpec) -> CompiledScene:
    """Build the model of `scene`. Raises BackendError, with MuJoCo's reason, for what it cannot build."""
    try:
        spec = _specify(scene)
        model = spec.compile()
    except ValueError as error:
        name = scene.robot.name if scene.robot else "bodies alone"
        raise BackendError(f"MuJoCo cannot build the scene of {name}: {' '.join(str(error).split())}") from error
    compiled = _locate(scene, model)
    if len(compiled.driven):
        _scale_solver(model, compiled)
    _damp(model, compiled)
    return compiled


def body_name(index: int) -> str:
    """Return the name of the MuJoCo body of scene body `index`."""
    return f"body/{index}"


def _specify(scene: SceneSpec) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    set_options(spec, scene)
    surfaces: list[Surface] = []
    if scene.ground:
        plane = spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
        plane.contype, plane.conaffinity = 0, 0
        surfaces.append(Surface(geom=plane.name, body="world", role="ground"))
    if scene.robot:
        surfaces += add_robot(spec, scene, scene.robot)
    driven_mass = DRIVEN_INERTIA * _moving_mass(scene)
    surfaces += [_add_body(spec, index, body, driven_mass) for index, body in enumerate(scene.bodies)]
    add_pairs(spec, scene, surfaces, neighbours(scene.robot) if scene.robot else frozenset())
    add_contact_sensors(spec, scene, surfaces)
    return spec


def _moving_mass(scene: SceneSpec) -> float:
    mass = sum(body.mass for body in scene.bodies if body.physics == "dynamic")
    if scene.robot:
        mass += sum(link.mass for link in scene.robot.links)
    return mass or 1.0


def _add_body(spec: mujoco.MjSpec, index: int, body: BodySpec, driven_mass: float) -> Surface:
    """Add one scene body with its frame at its centre of mass; return its surface.

    Static bodies are mocap bodies, placed at reset. A mocap body that moves has no velocity, and what it pushes would
    not be carried along; so driven bodies are free, weightless and far heavier than all else together.
    """
    if body.physics == "phantom":
        raise BackendError(f"body {index}: phantoms are not part of the physics; leave them out of the scene")
    mj = spec.worldbody.add_body(name=body_name(index))
    solid = of_shape(body.shape, density=1.0)
    if body.physics == "static":
        mj.mocap = True
    else:
        mj.add_freejoint(name=f"{body_name(index)}/free")
        if body.physics == "driven":
            mj.gravcomp = 1.0
            set_inertia(mj, driven_mass, (0.0, 0.0, 0.0), driven_mass * np.eye(3))
        else:
            set_inertia(mj, body.mass, (0.0, 0.0, 0.0), np.asarray(solid.inertia) * body.mass / solid.mass)
    pose = Pose(position=as_vector(np.negative(solid.com)))
    geom = add_geom(spec, mj, f"{body_name(index)}/0", body.shape, pose)
    return Surface(
        geom=geom.name, body=mj.name, role=body.physics, friction=body.friction, restitution=body.restitution
    )


def _locate(scene: SceneSpec, model: mujoco.MjModel) -> CompiledScene:
    """Look every link, joint and body of `scene` up in the compiled model."""
    robot = scene.robot
    joints = [model.joint(joint_name(joint.name)) for joint in robot.joints] if robot else []
    links = [_body_id(model, link_body(link.name)) for link in robot.links] if robot else []
    kinds = [body.physics for body in scene.bodies]
    free = [i for i, kind in enumerate(kinds) if kind != "static"]
    fixed = [i for i, kind in enumerate(kinds) if kind == "static"]
    free_joints = [model.joint(f"{body_name(i)}/free") for i in free]
    bodies = [model.body(body_name(i)).id for i in range(len(kinds))]
    if robot and robot.floating:
        base = model.joint(FREE_JOINT)
        assert base.qposadr[0] == 0 and base.dofadr[0] == 0
    return CompiledScene(
        scene=scene,
        model=model,
        link_body=_indices(links),
        body_body=_indices(bodies),
        joint_qpos=_indices(joint.qposadr[0] for joint in joints),
        joint_dof=_indices(joint.dofadr[0] for joint in joints),
        base_free=robot is not None and robot.floating,
        base_mocap=int(model.body_mocapid[links[0]]) if robot and robot.base == "fixed" else None,
        free=_indices(free),
        free_qpos=_indices(joint.qposadr[0] for joint in free_joints),
        free_dof=_indices(joint.dofadr[0] for joint in free_joints),
        driven=_indices(k for k, i in enumerate(free) if kinds[i] == "driven"),
        fixed=_indices(fixed),
        fixed_mocap=_indices(model.body_mocapid[bodies[i]] for i in fixed),
        contact=contact_readout(scene, model),
    )


def _scale_solver(model: mujoco.MjModel, compiled: CompiledScene) -> None:
    """Leave driven bodies out of the mean inertia by which the solver scales its tolerance.

    With them it would stop before it has converged for anything else.
    """
    own = compiled.own_dofs
    if own.any():
        model.stat.meaninertia = model.dof_M0[own].mean()


def _damp(model: mujoco.MjModel, compiled: CompiledScene) -> None:
    """Let the velocities of damped bodies fall by exp(-c h) in a timestep h.

    MuJoCo divides them by 1 + h d / m, d the damping of the free joint and m the mass (the inertia for the spin), which
    is the same for d = m (exp(c h) - 1) / h.
    """
    for index, dof in zip(compiled.free, compiled.free_dof, strict=True):
        body = compiled.scene.bodies[index]
        if body.physics == "dynamic" and body.damping > 0.0:
            rate = np.expm1(body.damping * compiled.scene.timestep) / compiled.scene.timestep
            solid = of_shape(body.shape, density=1.0)
            model.dof_damping[dof : dof + 3] = rate * body.mass
            model.dof_damping[dof + 3 : dof + 6] = rate * body.mass * np.diag(solid.inertia) / solid.mass


def _body_id(model: mujoco.MjModel, name: str) -> int:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)  # -1, NO_BODY, when merged away


def _indices(values) -> Indices:
    return np.array([int(value) for value in values], np.intp)
