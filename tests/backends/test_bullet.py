"""What is special about Bullet: its hidden defaults, its missing armature, its caches. The contract is conformance."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pybullet")

from guard_api.errors import BackendError
from guard_api.model.dynamics import Dynamics
from guard_api.model.library import load_robot
from guard_api.model.robot import Actuator, Collision, Joint, Link, RobotModel
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start
from guard_api.shapes import Box, Mesh, Pose
from guard_api.testing import robots
from guard_api.testing.conformance import check_robots, find, run_check
from guard_api.testing.scenes import (
    MOTION,
    WEIGHTLESS,
    bodies_scene,
    body,
    differing,
    effort_actuator,
    idle,
    one_joint,
    pusher,
    robot_scene,
    running,
    tree,
)
from guard_bullet import backend, dominance
from guard_bullet.compile import approximations
from guard_bullet.dominance import geared_joints
from guard_bullet.engine import quiet
from guard_bullet.massless import token_links
from guard_bullet.passive import EngineSolution, PlanarBody
from guard_bullet.surfaces import surfaces

CUBE = tuple((x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))


def different_starts(scene, num_worlds):
    rng = np.random.default_rng(2)
    start = home_start(scene, num_worlds)
    start.joint_velocity[:] = rng.normal(size=start.joint_velocity.shape)
    return start


def play(world, steps, first=0, substeps=3):
    controls = idle(world).shape[1]
    for i in range(first, first + steps):
        wave = 0.3 * np.sin(0.3 * i + np.arange(controls) + np.arange(world.num_worlds)[:, None])
        world.step(wave, substeps)
    return world.state()


def test_the_engine_is_silent_and_its_errors_are_not(capfd):
    code = (
        "from guard_bullet import backend; from guard_api.scene.spec import SceneSpec;"
        "backend.build(SceneSpec(robot=None), 1)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
    with pytest.raises(ValueError, match="why"), quiet():
        os.write(1, b"the engine's last words")
        raise ValueError("why")
    assert "last words" in capfd.readouterr().err


def test_point_reaches_the_published_speeds():
    robot = load_robot("point")
    scene = SceneSpec(robot=robot, timestep=robot.timestep)
    root = robot.link_index(robot.root)
    for control, expected in (((1.0, 0.0), (1.5, 0.0)), ((0.0, 1.0), (0.0, 3.0))):
        with running(backend, scene) as world:
            for _ in range(300):
                world.step(np.array([control]), robot.substeps)
            state = world.state()
        turn = state.link_angular_velocity[0, root, 2]
        assert turn == pytest.approx(expected[1], rel=0.01, abs=1e-9)
        if expected[0]:
            assert state.link_linear_velocity[0, root, 0] == pytest.approx(expected[0], rel=0.01)


def test_point_follows_the_written_recursion():
    # Its yaw servo chatters by design (kd h exceeds the inertia); chaos hides rounding, so yaw is driven directly here.
    point = load_robot("point")
    turn = Actuator(name="z", law="effort", joint="base_yaw", gear=0.015)
    robot = replace(point, actuators=(point.actuators[0], turn))
    scene = SceneSpec(robot=robot, timestep=robot.timestep)
    dynamics, h = Dynamics(robot), robot.timestep
    origin, facing, zero = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3))
    q, qd = np.zeros((1, 3)), np.zeros((1, 3))
    with running(backend, scene) as world:
        law = world._drive.law
        for i in range(200):
            control = np.array([[np.cos(0.1 * i), np.sin(0.07 * i)]])
            geared = law.geared(control)
            for _ in range(robot.substeps):
                poses = dynamics.kinematics.poses(origin, facing, q)
                a = dynamics.acceleration(
                    poses, zero, zero, qd, effort=law.joint_effort(geared, q, qd), thrust=law.thrust(geared), timestep=h
                )
                qd = qd + h * a
                q = q + h * qd
            world.step(control, robot.substeps)
        state = world.state()
    assert np.abs(state.joint_position - q).max() < 1e-9
    assert np.abs(state.joint_velocity - qd).max() < 1e-9


@pytest.mark.parametrize("base", ["floating", "fixed", "planar"])
def test_the_engines_equations_are_the_neutral_ones(base):
    robot = tree(base, damping=0.4, armature=0.02)
    scene = robot_scene(robot, gravity=(0.5, -1.0, -9.0))
    rng = np.random.default_rng(1)
    start = {"joint_position": rng.normal(size=len(robot.joints)), "joint_velocity": rng.normal(size=len(robot.joints))}
    if base != "planar":
        start["base_quaternion"] = np.array([0.1, -0.5, 0.7, 0.5])
    effort = rng.normal(size=(1, len(robot.joints)))
    with running(backend, scene, **start) as world:
        motion = world._drive.motion
        got = EngineSolution(scene, robot)(world._instances, motion, effort, np.zeros((1, 0, 3)))
    dynamics = Dynamics(robot, scene.gravity)
    poses = dynamics.kinematics.poses(motion.base_position, motion.base_quaternion, motion.q)
    expected = dynamics.acceleration(
        poses, motion.base_linear, motion.base_angular, motion.qd, effort=effort, thrust=np.zeros((1, 0, 3)),
        timestep=scene.timestep,
    )[:, -len(robot.joints) :]  # fmt: skip
    np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-9)


def test_the_closed_form_is_used_only_where_it_holds():
    point = load_robot("point")
    assert PlanarBody.fits(point)
    turned = replace(point.joints[0], axis=(0.0, 1.0, 0.0))
    assert not PlanarBody.fits(replace(point, joints=(turned, *point.joints[1:])))
    assert not PlanarBody.fits(tree("planar"))


@pytest.mark.parametrize("name", ["point", "tree", "ant"])
def test_a_world_has_the_same_bits_in_any_company(name):
    robot = {"point": lambda: load_robot("point"), "tree": lambda: tree(damping=0.3), "ant": robots.ant}[name]()
    scene = SceneSpec(robot=robot, timestep=0.002)
    states = []
    for num_worlds in (1, 3, 8):
        world = backend.build(scene, num_worlds)
        start = different_starts(scene, 8)
        rows = {field: getattr(start, field)[:num_worlds] for field in start.__dataclass_fields__}
        world.reset(np.ones(num_worlds, bool), type(start)(**rows))
        states.append(play(world, 60))
        world.close()
    for other in states[1:]:
        assert differing(states[0], other, worlds=slice(0, 1)) == []


def test_an_ant_on_its_feet_forgets_resumes_and_repeats():
    scene = SceneSpec(robot=robots.ant(), timestep=0.002)
    start = different_starts(scene, 2)
    worlds = [backend.build(scene, 2) for _ in range(2)]
    for world in worlds:
        world.reset(np.ones(2, bool), start)
    first = play(worlds[0], 120)
    assert first.touch.sum() > 0
    blob = worlds[0].snapshot()
    onward = play(worlds[0], 30, first=120)
    play(worlds[1], 7)
    worlds[1].restore(blob)
    assert differing(first, worlds[1].state()) == []
    assert differing(onward, play(worlds[1], 30, first=120)) == []
    worlds[1].reset(np.ones(2, bool), start)
    assert differing(first, play(worlds[1], 120)) == []
    for world in worlds:
        world.close()


@pytest.mark.parametrize("armature", [0.2, 2.0, 20.0])
def test_contacts_feel_armature(armature):
    """A slider of 2 kg with armature pushes a box of 1 kg: they accelerate by F / (3 + armature), not by F / 3."""
    robot = one_joint(
        "prismatic", collisions=pusher().links[1].collisions, actuators=(effort_actuator(),), armature=armature
    )
    scene = bodies_scene(("box", body(), 1), robot=robot, gravity=WEIGHTLESS, ground=False)
    force = 2.0 * (3.0 + armature)
    with running(backend, scene, body_position=(0.2, 0.0, 0.0)) as world:
        world.step(idle(world) + force, 200)
        state = world.state()
    assert state.body_contact.all()
    assert state.joint_velocity[0, 0] == pytest.approx(0.4 * 2.0, rel=0.02)
    assert "armature" not in " ".join(world.approximations)


def test_contacts_feel_implicit_damping():
    """A link of grams on a joint with damping of 5000, pushed by a kilogram: it yields as if in honey."""
    robot = one_joint(mass=1e-3, collisions=pusher().links[1].collisions, damping=5000.0)
    scene = bodies_scene(("box", body(friction=0.0), 1), robot=robot, gravity=WEIGHTLESS, ground=False)
    start = {"body_position": (-0.2, 0.0, 0.0), "body_linear_velocity": (1.0, 0.0, 0.0)}
    with running(backend, scene, **start) as world:
        world.step(idle(world), 10)
        state = world.state()
    assert state.joint_position[0, 0] < 1e-3
    assert abs(state.body_linear_velocity[0, 0, 0]) < 0.1


@pytest.mark.parametrize("armature", [0.05, 5.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_joints_with_rotors_stop_at_limits_and_stick(sign, armature):
    robot = one_joint(
        "revolute", actuators=(effort_actuator(),), armature=armature, limits=(-0.3, 0.3), friction_loss=2.0
    )
    with running(backend, robot_scene(robot)) as world:
        world.step(idle(world) + sign * 1.9, 100)
        assert world.state().joint_position[0, 0] == pytest.approx(0.0, abs=1e-6)
        world.step(idle(world) + sign * 3.0, 50)
        moving = sign * world.state().joint_velocity[0, 0]
        assert moving == pytest.approx(0.1 * (3.0 - 2.0) / (0.05 + armature), rel=0.02)
        world.step(idle(world) + sign * 7.0, 1000)
        state = world.state()
    assert sign * state.joint_position[0, 0] == pytest.approx(0.3, abs=1e-5)
    assert state.joint_velocity[0, 0] == pytest.approx(0.0, abs=1e-5)


def test_all_joints_rest_at_their_upper_stops_at_once():
    """The engine's direct solver does not couple an upper stop to a gear: wheels hold upper stops instead."""
    robot = robots.ant()
    upper = np.array([joint.limits[1] for joint in robot.joints])
    with running(backend, robot_scene(robot, timestep=0.005), joint_position=upper - 0.1) as world:
        world.step(idle(world) + 0.1, 400)
        state = world.state()
    np.testing.assert_allclose(state.joint_position[0], upper, atol=1e-4)


def test_a_sliding_ant_feels_the_friction_asked_for_on_average_over_directions():
    slope, felt = np.arctan(0.5) + 0.3, []
    across, down = 9.81 * np.sin(slope), 9.81 * np.cos(slope)
    for heading in np.deg2rad([0.0, 15.0, 30.0, 45.0]):
        along = np.array([np.cos(heading), np.sin(heading), 0.0])
        gravity = tuple((across * along - [0.0, 0.0, down]).tolist())
        scene = SceneSpec(robot=robots.ant(friction=0.5), timestep=0.005, gravity=gravity)
        # Slides fast enough to keep its direction.
        with running(backend, scene, base_linear_velocity=5.0 * along) as world:
            world.step(idle(world), 20)
            before = world.state().link_linear_velocity[0, 0] @ along
            world.step(idle(world), 20)
            gain = world.state().link_linear_velocity[0, 0] @ along - before
        felt.append((across - gain / 0.1) / down)
    assert felt[0] == pytest.approx(0.5 * np.pi / 4, rel=0.02)
    assert np.average(felt, weights=[1, 2, 2, 1]) == pytest.approx(0.5, rel=0.03)
    assert "on average" in " ".join(approximations(scene))


def test_without_rotors_the_ground_would_not_feel_armature(monkeypatch):
    monkeypatch.setattr(dominance, "NEGLIGIBLE", np.inf)
    assert run_check(backend, find("acceleration")).passed
    assert run_check(backend, find("contacts_feel_armature")).status == "failed"


def test_an_armature_without_a_rotor_is_admitted():
    robot = one_joint(collisions=pusher().links[1].collisions, armature=0.01)
    assert geared_joints(robot_scene(robot), robot) == []
    scene = bodies_scene(("box", body(), 1), robot=robot)
    assert "without their armature" in " ".join(approximations(scene))
    assert approximations(bodies_scene(("box", body(friction=1.0), 1), robot=pusher())) == ()


def test_hinges_in_line_across_a_massless_link_move_as_the_model_says():
    hopper = load_robot("hopper")
    assert check_robots(backend, [hopper], ["C4"]).passed
    assert token_links(hopper) == ["hip_x", "hip_z", "hip_y"]
    assert "hip_x, hip_z, hip_y have 1e-09" in " ".join(approximations(robot_scene(hopper)))
    assert token_links(load_robot("point")) == []


def test_a_leaning_leg_gives_way_at_its_massless_hip():
    """Hopper put on a leg that leans at the hip: within half a second the leg is upright and bears what it should."""
    robot = load_robot("hopper")
    scene = SceneSpec(robot=robot, timestep=robot.timestep)
    q = home_start(scene, 1).joint_position[0]
    q[robot.joint_index("hip_y")] = 0.2
    with running(backend, scene, joint_position=q) as world:
        world.step(idle(world), 80)
        world.step(idle(world), 40)
        state = world.state()
    assert abs(state.joint_position[0, robot.joint_index("hip_y")]) < 0.03
    assert state.touch.sum() == pytest.approx(30.9, rel=0.06)


def test_surfaces_multiply_to_the_pairs_that_the_scene_asks_for():
    scene = bodies_scene(("slab", body(friction=0.8), 1), ("box", body(friction=0.1), 1))
    chosen = surfaces(scene)
    slab, box = (chosen.of_mover(mu, 0.0)[0] for mu in (0.8, 0.1))
    assert slab * box == pytest.approx(0.8)
    assert (slab * chosen.friction, box * chosen.friction) == pytest.approx((0.8, 0.1))
    assert approximations(scene) == ()
    third = bodies_scene(*((name, body(friction=mu), 1) for name, mu in (("a", 0.1), ("b", 0.4), ("c", 0.8))))
    assert len(approximations(third)) == 1
    assert "'b'" in approximations(third)[0]
    assert "'c'" in approximations(third)[0]


def test_hulls_and_unions_of_shapes_carry_weight():
    mesh = Mesh(vertices=CUBE, source="cube")
    union = (Collision(shape=mesh), Collision(shape=Box(half_extents=(0.1, 0.1, 0.1)), pose=Pose(position=(0.5, 0, 0))))
    link = Link(name="hull", mass=1.0, com=(0.25, 0, 0), inertia=((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)),
                collisions=union)  # fmt: skip
    robot = RobotModel(name="union", base="floating", root="hull", links=(link,), joints=(), actuators=(),
                       sensors=(robots.touch_sensor("hull"),))  # fmt: skip
    scene = bodies_scene(("crate", replace(body(), shape=mesh), 1), robot=robot)
    with running(backend, scene, base_position=(0, 0, 0.11), body_position=(0, 3, 0.11)) as world:
        world.step(idle(world), 500)
        state = world.state()
    assert state.link_position[0, 0, 2] == pytest.approx(0.1, abs=3e-3)
    assert state.body_position[0, 0, 2] == pytest.approx(0.1, abs=3e-3)
    assert state.touch[0, 0] == pytest.approx(9.81, rel=1e-2)
    assert "inflated" in " ".join(world.approximations)


def test_the_native_preset_keeps_the_robots_dynamics():
    robot = robots.floating_tree()
    states = []
    for preset in ("rigid", "native"):
        with running(backend, robot_scene(robot, gravity=(0, 0, -9.81), preset=preset)) as world:
            states.append(play(world, 50))
    assert differing(*states, MOTION) == []


def test_impossible_requests_are_named():
    links = [Link(name=f"l{i}", mass=1.0, inertia=((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))) for i in range(124)]
    joints = [Joint(name=f"j{i}", kind="continuous", parent=f"l{i}", child=f"l{i + 1}") for i in range(123)]
    long = RobotModel(name="eel", base="fixed", root="l0", links=tuple(links), joints=tuple(joints), actuators=())
    with pytest.raises(BackendError, match=r"'eel' has 123 joints"):
        backend.build(robot_scene(long), 1)
    scene = bodies_scene(("wall", body("static"), 1))
    with running(backend, scene) as world, pytest.raises(BackendError, match="'wall' is not driven"):
        world.drive("wall", np.zeros((1, 1, 3)), np.array([[[1.0, 0, 0, 0]]]))
    with pytest.raises(BackendError, match="phantom"):
        backend.build(bodies_scene(("ghost", body("phantom"), 1)), 1)
