"""C12 with contacts: a floating robot on four feet, whose joints have armature.

Armature is inertia that the joint feels and nothing else does. An engine that keeps it out of its contact solver moves
such a robot rightly in the air and wrongly on the ground; so here the ground pushes, and a reference says what follows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.model.dynamics import Dynamics
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import ActuationLaw
from guard_api.physics.backend import Backend
from guard_api.scene.spec import SceneSpec
from guard_api.testing.checks.check import Finding, check, count, error
from guard_api.testing.ideal.bodies import turned
from guard_api.testing.ideal.stops import inelastic
from guard_api.testing.robots import ANT_LEG, ant
from guard_api.testing.scenes import TIMESTEP, idle, running

Array = NDArray[np.float64]

STEPS = 40
ANKLE = np.pi / 4
PUSH = np.array([0.0, 3.0, 0.0, 2.0, 0.0, 2.5, 0.0, 1.5])
"""Efforts that press every foot on the floor, each differently; hips idle. A multiple of it is applied."""

G = 9.81


class SmoothFloor:
    """Steps an ant whose feet stand on a frictionless floor as long as it pushes them.

    With A = M + armature + h D, J the normal velocities of the feet per coordinate and u* the step without a floor, the
    floor's impulses p >= 0 bring u = u* + A^-1 J' p to J u >= 0: an inelastic contact, exact for any armature.
    position (3,), quaternion (4,), q (J,), velocity (6 + J,): as in `Inspection`.
    """

    def __init__(self, robot: RobotModel, height: float, speed: float) -> None:
        self._dynamics, self._law = Dynamics(robot), ActuationLaw(robot)
        self._feet = [i for i, link in enumerate(robot.links) if link.name.startswith("shin")]
        self._tips = np.array([2.0 * np.array(robot.links[i].com) for i in self._feet])
        self.position, self.quaternion = np.array([0.0, 0.0, height]), np.array([1.0, 0.0, 0.0, 0.0])
        self.q = np.tile([0.0, ANKLE], len(self._feet))
        self.velocity = np.zeros(6 + len(robot.joints))
        self.velocity[2] = speed

    def step(self, control: Array) -> None:
        """Advance by one timestep under `control` (U,)."""
        q, u = self.q[None], self.velocity[None]
        poses = self._dynamics.kinematics.poses(self.position[None], self.quaternion[None], q)
        effort = self._law.joint_effort(self._law.geared(control[None]), q, u[:, 6:])
        matrix, right = self._dynamics.equations(
            poses, u[:, :3], u[:, 3:6], u[:, 6:], effort=effort, thrust=np.zeros((1, 0, 3)), timestep=TIMESTEP
        )
        free = self.velocity + TIMESTEP * np.linalg.solve(matrix[..., 0], right[:, 0])
        J = self._normal_velocities()
        self.velocity = inelastic(matrix[..., 0], free, J, np.zeros(len(J)))
        self.position = self.position + TIMESTEP * self.velocity[:3]
        self.quaternion = turned(self.quaternion, TIMESTEP * self.velocity[3:6])
        self.q = self.q + TIMESTEP * self.velocity[6:]

    def _normal_velocities(self) -> Array:
        """Return J (feet, 6 + J): one world per coordinate moves at unit speed in that coordinate alone."""
        kinematics, size = self._dynamics.kinematics, len(self.velocity)
        unit = np.eye(size)
        rows = [np.tile(array, (size, 1)) for array in (self.position, self.quaternion, self.q)]
        poses = kinematics.poses(*rows)
        linear, angular = kinematics.velocities(poses, unit[:, :3], unit[:, 3:6], unit[:, 6:])
        arm = rotations.rotate(poses.quaternion[:, self._feet], self._tips)
        return (linear[:, self._feet] + np.cross(angular[:, self._feet], arm))[..., 2].T


def _against_the_floor(backend: Backend, robot: RobotModel, effort: float, speed: float, what: str) -> list[Finding]:
    """Compare base and joints of an ant that stands on a smooth floor with the reference, over 0.08 s.

    effort: [N m] times `PUSH`. speed: of the landing [m/s]. Tolerances are shares of the fastest motion: 1 % in the
    joints; 5 % in the base, whose grams the solvers of two engines leave to the last.
    """
    height = 0.02 + ANT_LEG * np.sin(ANKLE)
    floor = SmoothFloor(robot, height, speed)
    start = {"base_position": (0.0, 0.0, height), "base_linear_velocity": (0.0, 0.0, speed)}
    control = effort * PUSH / robot.actuators[0].gear
    with running(backend, SceneSpec(robot=robot, timestep=TIMESTEP), joint_position=floor.q, **start) as world:
        for _ in range(STEPS):
            floor.step(control)
            world.step(control[None], 1)
        state = world.state()
    expected = floor.velocity
    fastest = max(abs(speed), float(np.abs(expected[:3]).max()), ANT_LEG * float(np.abs(expected[6:]).max()))
    base = np.concatenate([state.link_linear_velocity[0, 0], 0.1 * state.link_angular_velocity[0, 0]])
    base_expected = np.concatenate([expected[:3], 0.1 * expected[3:6]])
    return [
        error(f"joint velocities {what}", state.joint_velocity[0], expected[6:], 0.01 * fastest / ANT_LEG, "rad/s"),
        error(f"velocity of the base {what}", base, base_expected, 0.05 * fastest, "m/s"),
    ]


@check("C12", contacts=True)
def contacts_feel_armature(backend: Backend) -> list[Finding]:
    """Feet pressed on a smooth floor, or landing on it, move joints and base as the armature demands.

    GUARD's ant, whose rotors outweigh it a thousandfold, and one of 2.7 kg whose rotors weigh as much as it does.
    """
    light = ant(friction=0.0, damping=0.1)
    heavy = ant(friction=0.0, density=1000.0, armature=0.05, damping=0.005)
    return [
        *_against_the_floor(backend, light, 2.0, 0.0, "of a pushing ant of 14 g"),
        *_against_the_floor(backend, light, 0.0, -0.5, "of a landing ant of 14 g"),
        *_against_the_floor(backend, heavy, 1.0, 0.0, "of a pushing ant of 2.7 kg"),
        *_against_the_floor(backend, heavy, 0.0, -0.5, "of a landing ant of 2.7 kg"),
    ]


@check("C12", contacts=True)
def ant_at_rest(backend: Backend) -> list[Finding]:
    """GUARD's ant rests at its height on four feet, at its own coarse timestep and finer; they carry its weight."""
    robot = ant()
    weight = G * sum(link.mass for link in robot.links)
    findings = []
    for h in (0.02, 0.005):
        with running(backend, SceneSpec(robot=robot, timestep=h)) as world:
            world.step(idle(world), round(2.0 / h))
            world.step(idle(world), round(0.5 / h))
            state = world.state()
        # The softest preset sinks in proportion to h^2, by 0.9 mm at 0.02 s.
        height = state.link_position[0, 0, 2]
        findings += [
            error(f"height, timestep {h:g} s", height, robot.home.height, 1e-4 + 2.5 * h**2, "m"),
            error(f"sum of foot forces, timestep {h:g} s", state.touch[0].sum(), weight, 0.02 * weight, "N"),
        ]
    return findings


@check("C12", contacts=True)
def ant_survives_anything(backend: Backend) -> list[Finding]:
    """Under random full efforts of GUARD's ant, at its coarse timestep, nothing diverges and joint stops hold.

    A stop holds to a step's travel, here of a rotor driven from stop to stop: 7 rad/s, twice for a stop that yields.
    """
    robot, worlds = ant(), 4
    limits = np.array([joint.limits for joint in robot.joints])
    rng, over, heights = np.random.default_rng(3), 0.0, []
    with running(backend, SceneSpec(robot=robot, timestep=robot.timestep), worlds) as world:
        for _ in range(60):
            world.step(rng.uniform(-1.0, 1.0, (worlds, len(robot.actuators))), 10)
            state = world.state()
            beyond = np.maximum(limits[:, 0] - state.joint_position, state.joint_position - limits[:, 1])
            over = np.maximum(over, beyond.max())
            heights.append(state.link_position[:, 0, 2])
        lost = int((~world.state().ok).sum())
    return [
        count("worlds that diverged", lost),
        Finding(what="joints beyond their stops", value=float(over), tolerance=2 * 7.0 * robot.timestep, unit="rad"),
        Finding(what="highest torso", value=float(np.max(heights)), tolerance=0.3, unit="m"),
        Finding(what="depth of the lowest torso", value=float(-np.min(heights)), tolerance=-0.06, unit="m"),
    ]
