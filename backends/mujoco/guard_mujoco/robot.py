"""A RobotModel as MuJoCo bodies, joints and actuators.

MuJoCo refuses moving bodies without mass, so a chain of massless links and the link with mass at its end become one
body with several joints; positions of all links are recovered in `guard_mujoco.readout`.
"""

# MuJoCo is a compiled module without type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.model.robot import Actuator, Joint, Link, RobotModel
from guard_api.scene.spec import SceneSpec
from guard_api.shapes import Pose
from guard_mujoco.contact import Neighbours, Role, Surface, stiffen_joint
from guard_mujoco.shapes import add_geom, compose, set_inertia

FREE_JOINT = "robot/free"
UNLIMITED = 1e10
"""Stands for infinity where one end of a range must be finite: MuJoCo's own bound on numbers."""


def link_body(link: str) -> str:
    """Return the name of the MuJoCo body of a link with mass, and of the first link."""
    return f"link/{link}"


def joint_name(joint: str) -> str:
    """Return the name of the MuJoCo joint."""
    return f"joint/{joint}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """What moves one link with mass: `joints` from `parent`, the nearest ancestor with a body, down to `link`."""

    link: Link
    parent: str
    joints: tuple[Joint, ...]

    @property
    def limb(self) -> bool:
        """Whether the link swings between limits as a leg does; wheels turn on and on, and trunks may slide."""
        return all(joint.kind == "revolute" for joint in self.joints)


def chains(robot: RobotModel) -> list[Chain]:
    """Return the chain of every link with mass but the first, parents before children.

    Raises BackendError for a massless link that carries anything but one joint.
    """
    by_name = {link.name: link for link in robot.links}
    joint_of = {joint.child: joint for joint in robot.joints}
    first = robot.links[0].name
    result = []
    for link in robot.links[1:]:
        if link.virtual:
            carried = sum(joint.parent == link.name for joint in robot.joints)
            if carried != 1 or link.collisions:
                raise BackendError(
                    f"robot {robot.name!r}: massless link {link.name!r} carries {carried} joints and "
                    f"{len(link.collisions)} collisions; MuJoCo needs one joint and none, or a mass"
                )
            continue
        joints = [joint_of[link.name]]
        while joints[0].parent != first and by_name[joints[0].parent].virtual:
            joints.insert(0, joint_of[joints[0].parent])
        result.append(Chain(link=link, parent=joints[0].parent, joints=tuple(joints)))
    return result


def neighbours(robot: RobotModel) -> Neighbours:
    """Return the pairs of MuJoCo bodies that a joint, or a chain of them through massless links, connects."""
    return frozenset(frozenset((link_body(c.parent), link_body(c.link.name))) for c in chains(robot))


def add_robot(spec: mujoco.MjSpec, scene: SceneSpec, robot: RobotModel) -> list[Surface]:
    """Add the robot's bodies, joints, collisions and actuators to `spec`; return its surfaces."""
    first = robot.links[0]
    base = spec.worldbody.add_body(name=link_body(first.name))
    if robot.floating:
        base.add_freejoint(name=FREE_JOINT)
    # A fixed base is placed anew at every reset; a planar one stays at the origin, its joints move it.
    base.mocap = robot.base == "fixed"
    role: Role = "robot" if robot.collide_ground else "robot above ground"
    surfaces = _fill(spec, base, first, role if robot.floating else "robot base")
    bodies = {first.name: base}
    for chain in chains(robot):
        body = _add_chain(scene, bodies[chain.parent], chain)
        bodies[chain.link.name] = body
        surfaces += _fill(spec, body, chain.link, role, limb=chain.limb)
    for index, actuator in enumerate(robot.actuators):
        _add_actuator(spec, robot, index, actuator)
    return surfaces


def _fill(spec: mujoco.MjSpec, body: mujoco.MjsBody, link: Link, role: Role, limb: bool = False) -> list[Surface]:
    """Give `body` the mass and collisions of `link`; return their surfaces."""
    if not link.virtual:
        set_inertia(body, link.mass, link.com, np.asarray(link.inertia))
    surfaces = []
    for number, collision in enumerate(link.collisions):
        geom = add_geom(spec, body, f"{body.name}/{number}", collision.shape, collision.pose)
        surfaces.append(Surface(geom=geom.name, body=body.name, role=role, limb=limb, friction=collision.friction))
    return surfaces


def _add_chain(scene: SceneSpec, parent: mujoco.MjsBody, chain: Chain) -> mujoco.MjsBody:
    """Add the body of `chain.link` with all joints of the chain, stated in the axes of that body at rest.

    With T_k the pose of joint k's link at rest and J_k its motion there, the link is at T_1 J_1 (T_1^-1 T_2) J_2 ...;
    MuJoCo applies the joints of a body in order, each in the body's axes as the previous ones left them, which is the
    same motion when joint k has its anchor and axis at T_n^-1 T_k.
    """
    rest = [Pose()]
    for joint in chain.joints:
        rest.append(compose(rest[-1], joint.origin))
    tip = rest[-1]
    body = parent.add_body(name=link_body(chain.link.name), pos=list(tip.position), quat=list(tip.quaternion))
    for joint, pose in zip(chain.joints, rest[1:], strict=True):
        offset = np.subtract(pose.position, tip.position)
        axis = rotations.rotate(pose.quaternion, joint.axis)
        mj = body.add_joint(name=joint_name(joint.name))
        mj.type = mujoco.mjtJoint.mjJNT_SLIDE if joint.kind == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE
        mj.pos = rotations.unrotate(tip.quaternion, offset)
        # The last joint's axis is the link's own: turning it there and back would only cost its last bits.
        mj.axis = list(joint.axis) if joint is chain.joints[-1] else rotations.unrotate(tip.quaternion, axis)
        mj.damping = [joint.damping, 0.0, 0.0]
        mj.stiffness, mj.springref = [joint.stiffness, 0.0, 0.0], joint.rest_position
        mj.frictionloss, mj.armature = joint.friction_loss, joint.armature
        mj.limited = joint.limits is not None
        if joint.limits is not None:
            mj.range = list(joint.limits)
        stiffen_joint(mj, scene)
    return body


def _add_actuator(spec: mujoco.MjSpec, robot: RobotModel, index: int, actuator: Actuator) -> None:
    """Add one actuator: force = gain clip(control) + bias, clipped; the four laws differ in gain and bias only.

    A thrust with a ceiling takes gear, range and offset from `guard_mujoco.ceilings`: its control is a force.
    """
    mj = spec.add_actuator(name=f"actuator/{index}")
    limit = actuator.effort_limit
    if actuator.law == "thrust":
        _set_thrust(spec, robot, mj, index, actuator)
    else:
        mj.trntype, mj.target = mujoco.mjtTrn.mjTRN_JOINT, joint_name(str(actuator.joint))
        limit = min(limit, _joint_limit(spec, robot, actuator))
    mj.set_to_motor()
    mj.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    kp, kd = actuator.kp, actuator.kd
    gain, bias = {
        "effort": (1.0, (0.0, 0.0, 0.0)),
        "thrust": (1.0, (actuator.offset, 0.0, 0.0)),
        "position": (kp, (kp * actuator.offset, -kp, -kd)),
        "velocity": (kd, (kd * actuator.offset, 0.0, -kd)),
    }[actuator.law]
    if np.isfinite(actuator.ceiling):
        mj.gainprm[0] = 1.0
    else:
        mj.gainprm[0] = gain * actuator.gear
        mj.biasprm[:3] = bias
        mj.ctrllimited = any(np.isfinite(actuator.ctrl_range))
        mj.ctrlrange = np.clip(actuator.ctrl_range, -UNLIMITED, UNLIMITED)
    mj.forcelimited = bool(np.isfinite(limit))
    if mj.forcelimited:
        mj.forcerange = [-limit, limit]


def _set_thrust(spec: mujoco.MjSpec, robot: RobotModel, mj: mujoco.MjsActuator, index: int, actuator: Actuator) -> None:
    """Let the actuator push on a site at its point, along its direction in link axes."""
    link = robot.links[robot.link_index(str(actuator.link))]
    if link.virtual:
        raise BackendError(f"actuator {actuator.name!r}: link {link.name!r} has no mass, MuJoCo cannot push it")
    site = spec.body(link_body(link.name)).add_site(name=f"thrust/{index}", pos=list(actuator.point))
    mj.trntype, mj.target = mujoco.mjtTrn.mjTRN_SITE, site.name
    mj.gear = [*actuator.direction, 0.0, 0.0, 0.0]


def _joint_limit(spec: mujoco.MjSpec, robot: RobotModel, actuator: Actuator) -> float:
    """Return what the joint's own effort limit adds to the actuator's.

    One actuator alone on its joint takes the limit itself. Several are clipped together by the joint, which in MuJoCo
    would also clip what thrusters elsewhere do to the joint: refused.
    """
    joint = robot.joints[robot.joint_index(str(actuator.joint))]
    sharing = [other.name for other in robot.actuators if other.joint == joint.name]
    if len(sharing) == 1 or not np.isfinite(joint.effort_limit):
        return joint.effort_limit
    if any(other.law == "thrust" for other in robot.actuators):
        raise BackendError(
            f"joint {joint.name!r}: its effort_limit binds {', '.join(sharing)} together, which MuJoCo cannot do in a "
            "robot with thrust actuators; give the limits to the actuators"
        )
    mj = spec.joint(joint_name(joint.name))
    mj.actfrclimited, mj.actfrcrange = True, [-joint.effort_limit, joint.effort_limit]
    return float("inf")
