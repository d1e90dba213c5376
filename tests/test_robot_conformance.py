"""The checks of one robot: shipped robots pass them on every engine, and a backend with a fault does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from guard_api import plugins
from guard_api.model.library import load_robot, robot_names
from guard_api.testing import robots
from guard_api.testing.checks.mechanics import held_bias_force
from guard_api.testing.checks.own_robot import OF_ROBOTS, robot_checks
from guard_api.testing.checks.rest import lies_on_floor
from guard_api.testing.conformance import run_check
from guard_api.testing.ideal.world import IdealBackend
from tests.engines import engine
from tests.faulty_backends import Bouncing, ClippedStops, FaultyBackend, with_actuators, with_joints

FAST = ("drone", "ant")
"""Between them they have every check: thrust, armature, stops, a floating base, and feet on the floor."""

UNREADABLE = {"floating_mass_matrix", "floating_bias_force"}
GAPS = {
    ("sapien", "ant"): UNREADABLE | {"stops_hold"},
    ("sapien", "car"): UNREADABLE,
    ("sapien", "doggo"): UNREADABLE,
}
"""Checks of shipped robots that do not hold, as docs/robots.md explains."""

ENGINES = [name for name in plugins.names("guard.backends") if name != "ideal"]


def of_robot(name, robot):
    (found,) = (item for item in robot_checks(robot) if item.name == f"{name}:{robot.name}")
    return found


@pytest.mark.parametrize("robot", FAST)
@pytest.mark.parametrize("backend", ENGINES)
def test_a_shipped_robot_is_the_same_robot(backend, robot):
    check_all(backend, robot)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [name for name in robot_names() if name not in FAST])
@pytest.mark.parametrize("backend", ENGINES)
def test_every_shipped_robot_is_the_same_robot(backend, robot):
    check_all(backend, robot)


def check_all(backend, robot):
    results = [run_check(engine(backend), item) for item in robot_checks(load_robot(robot))]
    assert not [(result.name, result.worst, result.reason) for result in results if not result.passed]
    gaps = {result.name.partition(":")[0] for result in results if result.status != "passed"}
    assert gaps == GAPS.get((backend, robot), set()), "a declared gap excuses only what is known not to hold"


def test_a_robot_has_the_checks_that_it_has_something_for():
    names = {robot: {item.name.split(":")[0] for item in robot_checks(load_robot(robot))} for robot in robot_names()}
    assert names["drone"] | names["ant"] >= set(OF_ROBOTS)
    assert "thrust_climb" not in names["ant"] and "falls_freely" not in names["drone"]
    assert "stops_hold" not in names["arm3"] and "joint_inertia" not in names["doggo"]
    assert [name for name in robot_names() if lies_on_floor(load_robot(name))] == [
        "ant", "car", "doggo", "drone", "swimmer",
    ]  # fmt: skip


def stretched(scene):
    """Move every stop outward by a hundredth of its joint's range."""
    joints = []
    for joint in scene.robot.joints:
        lower, upper = joint.limits or (0.0, 0.0)
        width = 0.01 * (upper - lower)
        joints.append(replace(joint, limits=(lower - width, upper + width) if joint.limits else None))
    return replace(scene, robot=replace(scene.robot, joints=tuple(joints)))


def swapped(scene):
    return replace(scene, robot=replace(scene.robot, actuators=tuple(reversed(scene.robot.actuators))))


def lightly(scene):
    return replace(scene, gravity=(0.0, 0.0, 0.99 * scene.gravity[2]))


def limited_tree():
    tree = robots.floating_tree()
    joints = tuple(replace(joint, kind="revolute", limits=(-1.0, 0.5)) for joint in tree.joints)
    return replace(tree, joints=joints)


DRONE, ARM, TREE = load_robot("drone"), robots.three_link_arm(), limited_tree()

FAULTS = {
    "extra damping": (with_joints(damping=0.04), [("energy_drift", TREE), ("actuator_response", ARM)]),
    "springs dropped": (with_joints(stiffness=0.0), [("energy_drift", load_robot("doggo"))]),
    "gravity a hundredth less": (
        FaultyBackend(scene=lightly), [("falls_freely", TREE), ("energy_drift", TREE), ("thrust_climb", DRONE)],
    ),
    "gears off by 1e-4": (
        FaultyBackend(scene=lambda s: replace(s, robot=replace(s.robot, actuators=tuple(
            replace(a, gear=1.0001 * a.gear) for a in s.robot.actuators)))),
        [("actuator_response", ARM)],
    ),
    "actuators in another order": (FaultyBackend(scene=swapped), [("actuator_response", ARM)]),
    "damping of servos dropped": (with_actuators(kd=0.0), [("actuator_response", ARM)]),
    "armature dropped": (with_joints(armature=0.0), [("joint_inertia", ARM), ("joint_inertia", TREE)]),
    "thrust offsets dropped": (with_actuators(offset=0.0), [("thrust_climb", DRONE), ("actuator_response", DRONE)]),
    "ceilings dropped": (with_actuators(ceiling=np.inf), [("thrust_climb", DRONE)]),
    "limits dropped": (with_joints(limits=None), [("stops_hold", ARM), ("stops_hold", DRONE)]),
    "limits a hundredth too wide": (FaultyBackend(scene=stretched), [("stops_hold", ARM), ("stops_hold", TREE)]),
    "stops that bounce": (FaultyBackend(Bouncing), [("stops_hold", ARM), ("stops_hold", TREE)]),
    "stops that only their joint feels": (FaultyBackend(ClippedStops), [("stops_hold", TREE)]),
}  # fmt: skip

CASES = [(fault, *case) for fault, (_, cases) in FAULTS.items() for case in cases]


@pytest.mark.parametrize(("fault", "name", "robot"), CASES, ids=[f"{f}: {n}, {r.name}" for f, n, r in CASES])
def test_fault_is_found(fault, name, robot):
    item = of_robot(name, robot)
    assert run_check(IdealBackend(), item).status == "passed", "the check does not hold without the fault either"
    assert run_check(FAULTS[fault][0], item).status == "failed", f"{name} does not notice {fault}"


class OnTheFloor:
    """MuJoCo with a fault: another scene than it was asked for."""

    def __init__(self, change):
        self.engine, self.change = engine("mujoco"), change
        self.name, self.capabilities = self.engine.name, self.engine.capabilities

    def build(self, scene, num_worlds, threads=1):
        return self.engine.build(self.change(scene), num_worlds, threads)


def thinner(scene):
    """Shrink the shapes of every link by 2 mm at their bottom: lift them in their links."""
    links = []
    for link in scene.robot.links:
        lifted = [
            replace(c, pose=replace(c.pose, position=(*c.pose.position[:2], c.pose.position[2] + 0.002)))
            for c in link.collisions
        ]
        links.append(replace(link, collisions=tuple(lifted)))
    return replace(scene, robot=replace(scene.robot, links=tuple(links)))


def heavy(scene):
    return replace(scene, gravity=tuple(1.05 * value for value in scene.gravity))


@pytest.mark.parametrize("change", [thinner, heavy])
def test_a_robot_that_does_not_rest_as_it_should_is_found(change):
    item = of_robot("rests_on_floor", DRONE)
    assert run_check(OnTheFloor(change), item).status == "failed"
    assert run_check(OnTheFloor(lambda scene: scene), item).status == "passed"


def test_a_gap_of_an_engine_excuses_only_the_robots_that_need_it():
    """The declared reason stands where the check does not hold, and a robot that passes simply passes."""
    faulty = FaultyBackend(Bouncing, gaps={"stops_hold": "it bounces"})
    assert run_check(faulty, of_robot("stops_hold", ARM)).status == "gap"
    sound = FaultyBackend(gaps={"stops_hold": "it bounces"})
    assert run_check(sound, of_robot("stops_hold", ARM)).status == "passed"


def test_a_joint_of_a_centimetre_is_checked_as_any_other(tmp_path):
    """Its random positions and speeds keep off the stops, so that what is compared is the mechanics."""
    inertial = "<inertial><mass value='0.5'/><inertia ixx='0.001' iyy='0.001' izz='0.001'/></inertial>"
    links = "".join(f"<link name='{name}'>{inertial}</link>" for name in ("palm", "finger"))
    slide = "<parent link='palm'/><child link='finger'/><axis xyz='1 0 0'/><limit lower='0' upper='0.01' effort='5'/>"
    file = tmp_path / "gripper.urdf"
    file.write_text(f"<robot name='gripper'>{links}<joint name='slide' type='prismatic'>{slide}</joint></robot>")
    results = [run_check(IdealBackend(), item) for item in robot_checks(load_robot(str(file)))]
    assert "stops_hold:gripper" in {result.name for result in results}
    assert not [(result.name, result.worst, result.reason) for result in results if result.status != "passed"]


def test_a_balanced_robot_is_the_same_robot(backend_name, tmp_path):
    """Its weights cancel about the hinge: the bias force is rounding on every engine, and in the reference too."""
    inertial = "<inertial><mass value='2'/><inertia ixx='0.03' iyy='0.03' izz='0.03'/></inertial>"
    links = "".join(f"<link name='{name}'>{inertial}</link>" for name in ("base", "fan"))
    hinge = "<parent link='base'/><child link='fan'/><origin xyz='0.1 0.05 0.2'/><axis xyz='0 1 0'/>"
    file = tmp_path / "fan.urdf"
    file.write_text(f"<robot name='fan'>{links}<joint name='hinge' type='continuous'>{hinge}</joint></robot>")
    finding = held_bias_force(plugins.load("guard.backends", backend_name), load_robot(str(file)))
    assert finding.holds, finding
