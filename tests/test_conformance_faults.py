"""Each check can fail: a backend with one deliberate fault fails the check that is there to find it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from guard_api import rotations
from guard_api.testing.conformance import find, run_check
from tests.engines import engine
from tests.faulty_backends import (
    CeilingForTheCom,
    ClippedSprings,
    Clipping,
    Coupled,
    Credulous,
    Deserted,
    Disturbed,
    EarlyCeiling,
    FaultyBackend,
    Forgetful,
    HeldEffort,
    Leaking,
    LingeringReset,
    LiveViews,
    Raising,
    RoundedClock,
    ShortStep,
    SilentReset,
    SpringsAmongEfforts,
    Stale,
    Trusting,
    Undead,
    WholeReset,
    at_com,
    faulty_state,
    with_actuators,
    with_bodies,
    with_joints,
    with_links,
)


def bad_order(scene):
    robot = scene.robot
    return replace(scene, robot=replace(robot, actuators=tuple(reversed(robot.actuators))))


FAULTS = {
    "velocities in link axes": (
        FaultyBackend(faulty_state(lambda s, r: {
            "link_linear_velocity": rotations.unrotate(s.link_quaternion, s.link_linear_velocity)})),
        ["links_after_reset", "links_after_motion"],
    ),
    "angular velocities in link axes": (
        FaultyBackend(faulty_state(lambda s, r: {
            "link_angular_velocity": rotations.unrotate(s.link_quaternion, s.link_angular_velocity)})),
        ["links_after_reset"],
    ),
    "poses and velocities at the com": (FaultyBackend(faulty_state(at_com)), ["links_after_reset"]),
    "velocities at the com": (
        FaultyBackend(faulty_state(lambda s, r: {"link_linear_velocity": at_com(s, r)["link_linear_velocity"]})),
        ["links_after_reset", "velocities_are_derivatives", "thrust_law"],
    ),
    "poses one step old": (FaultyBackend(Stale), ["links_after_motion"]),
    "quaternions with w last": (
        FaultyBackend(faulty_state(lambda s, r: {"link_quaternion": np.roll(s.link_quaternion, -1, axis=-1)})),
        ["quaternion_convention", "radians_and_sense", "links_after_reset"],
    ),
    "quaternions of the world in the link": (
        FaultyBackend(faulty_state(lambda s, r: {"link_quaternion": rotations.conjugate(s.link_quaternion)})),
        ["quaternion_convention"],
    ),
    "degrees": (
        FaultyBackend(faulty_state(lambda s, r: {"joint_position": np.rad2deg(s.joint_position)})),
        ["radians_and_sense", "joint_order"],
    ),
    "gravity turned": (
        FaultyBackend(scene=lambda s: replace(s, gravity=(s.gravity[2], s.gravity[0], s.gravity[1]))),
        ["gravity_axes", "free_fall", "pendulum_swing", "acceleration"],
    ),
    "joints in another order": (
        FaultyBackend(faulty_state(lambda s, r: {"joint_position": s.joint_position[:, ::-1].copy()})),
        ["joint_order"],
    ),
    "actuators in another order": (FaultyBackend(scene=bad_order), ["actuator_order", "acceleration"]),
    "float32 arrays": (
        FaultyBackend(faulty_state(lambda s, r: {"joint_position": s.joint_position.astype(np.float32)})),
        ["shapes_and_types"],
    ),
    "extra damping": (with_joints(damping=0.04), ["effort_law", "acceleration", "no_speed_limits", "pendulum_swing"]),
    "damping dropped": (with_joints(damping=0.0), ["damping_is_implicit", "chain_trajectory"]),
    "armature dropped": (with_joints(armature=0.0), ["armature_adds_inertia", "mass_matrix", "floating_mass_matrix"]),
    "springs dropped": (with_joints(stiffness=0.0), ["spring_law", "springs_swing_and_rest", "acceleration"]),
    "springs that rest at zero": (
        with_joints(rest_position=0.0), ["spring_law", "springs_swing_and_rest", "acceleration"],
    ),
    "springs clipped by the effort limit": (FaultyBackend(ClippedSprings), ["spring_law"]),
    "springs reported as efforts": (FaultyBackend(SpringsAmongEfforts), ["spring_law"]),
    "thrust offsets dropped": (with_actuators(offset=0.0), ["thrust_offset", "thrust_ceiling", "position_law"]),
    "ceilings dropped": (with_actuators(ceiling=np.inf), ["thrust_ceiling"]),
    "a ceiling seen within the step": (FaultyBackend(EarlyCeiling), ["thrust_ceiling"]),
    "a ceiling for the com": (FaultyBackend(CeilingForTheCom), ["thrust_ceiling"]),
    "limits dropped": (with_joints(limits=None), ["joint_stops"]),
    "effort limits dropped": (with_joints(effort_limit=np.inf), ["efforts_are_limited"]),
    "joint axes negated": (
        FaultyBackend(scene=lambda s: replace(s, robot=replace(s.robot, joints=tuple(
            replace(j, axis=tuple(-x for x in j.axis)) for j in s.robot.joints)))),
        ["radians_and_sense", "links_after_reset"],
    ),
    "a mass off by 1e-5": (with_links(lambda link: replace(link, mass=link.mass * 1.00001)), ["link_inertials"]),
    "a com at the link frame": (
        with_links(lambda link: replace(link, com=(0.0, 0.0, 0.0))),
        ["link_inertials", "mass_matrix", "bias_force", "acceleration", "base_acceleration", "thrust_law"],
    ),
    "inertia without its products": (
        with_links(lambda link: replace(link, inertia=tuple(map(tuple, np.diag(np.diag(link.inertia)))))),
        ["link_inertials", "floating_mass_matrix", "chain_trajectory"],
    ),
    "bodies undamped": (with_bodies(damping=0.0), ["damping_of_bodies"]),
    "all bodies damped": (with_bodies(damping=0.04), ["damping_of_bodies", "free_fall_of_bodies"]),
    "gears dropped": (
        FaultyBackend(scene=lambda s: replace(s, robot=replace(s.robot, actuators=tuple(
            replace(a, gear=1.0) for a in s.robot.actuators)))),
        ["effort_law", "position_law", "velocity_law", "thrust_law"],
    ),
    "controls not clipped": (
        FaultyBackend(scene=lambda s: replace(s, robot=replace(s.robot, actuators=tuple(
            replace(a, ctrl_range=(-np.inf, np.inf)) for a in s.robot.actuators)))),
        ["control_is_clipped"],
    ),
    "servos once per step": (FaultyBackend(HeldEffort), ["law_at_every_substep"]),
    "one substep too few": (FaultyBackend(ShortStep), ["time_advances", "substeps_compose"]),
    "a float32 clock": (FaultyBackend(RoundedClock), ["time_advances"]),
    "looking disturbs": (FaultyBackend(Disturbed), ["looking_changes_nothing"]),
    "live views": (FaultyBackend(LiveViews), ["arrays_are_the_callers"]),
    "a reset of all worlds": (FaultyBackend(WholeReset), ["reset_is_selective"]),
    "a reset that lingers": (FaultyBackend(LingeringReset), ["reset_forgets"]),
    "bits that depend on N": (FaultyBackend(Coupled), ["worlds_are_alone"]),
    "bits that depend on other worlds": (FaultyBackend(Leaking), ["worlds_are_alone", "reset_is_selective"]),
    "an exception for a NaN": (FaultyBackend(Raising), ["a_nan_stays_alone"]),
    "a silent reset": (FaultyBackend(SilentReset), ["a_nan_stays_alone", "a_blow_up_stays_alone"]),
    "infinite controls clipped": (FaultyBackend(Clipping), ["an_infinity_stays_alone", "all_may_fail_at_once"]),
    "an exception when no world is left": (FaultyBackend(Deserted), ["all_may_fail_at_once"]),
    "a reset of one that brings back all": (FaultyBackend(WholeReset), ["all_may_fail_at_once"]),
    "worlds that outlive their end": (FaultyBackend(Undead), ["a_closed_world_says_so"]),
    "any finite speed taken for physics": (FaultyBackend(Trusting), ["a_runaway_is_noticed"]),
    "snapshots without velocities": (
        FaultyBackend(Forgetful), ["restore_repeats", "restore_returns"],
    ),
    "any bytes taken for a snapshot": (FaultyBackend(Credulous), ["foreign_snapshots_refused"]),
    "contacts promised but not there": (
        FaultyBackend(contacts=True),
        ["touch_covers_all_substeps", "contact_flag_covers_all_substeps", "reset_clears_readouts", "resting_robot",
         "resting_bodies", "incline_sticks", "collision_keeps_momentum", "static_bodies_block", "driven_bodies_push"],
    ),
}  # fmt: skip

CASES = [(fault, name) for fault, (_, names) in FAULTS.items() for name in names]


@pytest.mark.parametrize(("fault", "name"), CASES, ids=[f"{fault}: {name}" for fault, name in CASES])
def test_fault_is_found(fault, name):
    result = run_check(FAULTS[fault][0], find(name))
    assert result.status in {"failed", "error"}, f"{name} does not notice {fault}"


class LastSubstepTouch:
    """A world of a real engine that reports touch of the last substep only."""

    def __init__(self, world):
        self.world = world

    def __getattr__(self, name):
        return getattr(self.world, name)

    def step(self, control, substeps):
        for _ in range(substeps):
            self.world.step(control, 1)


@pytest.mark.parametrize("name", ["touch_covers_all_substeps", "contact_flag_covers_all_substeps"])
def test_touch_of_the_last_substep_alone_is_found(name):
    mujoco = engine("mujoco")

    class Backend:
        name, capabilities = mujoco.name, mujoco.capabilities

        def build(self, scene, num_worlds, threads=1):
            return LastSubstepTouch(mujoco.build(scene, num_worlds, threads))

    assert run_check(Backend(), find(name)).status == "failed"
