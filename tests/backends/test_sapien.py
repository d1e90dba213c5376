"""What is special about SAPIEN: PhysX's hidden defaults, float32, shared scenes. The contract itself is conformance."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("sapien")

from guard_api.errors import BackendError
from guard_api.model.library import load_robot
from guard_api.model.robot import Collision
from guard_api.scene.start import home_start
from guard_api.shapes import Box, Cylinder, Sphere
from guard_api.testing import robots
from guard_api.testing.checks.own_robot import OF_ROBOTS, robot_checks
from guard_api.testing.conformance import find, run_check
from guard_api.testing.scenes import (
    MOTION,
    bodies_scene,
    body,
    differing,
    idle,
    loose_link,
    pusher,
    rest_start,
    robot_scene,
    running,
    tree,
)  # fmt: skip
from guard_sapien import GAPS, backend
from guard_sapien.fleet import WORLDS_PER_SCENE


def noise(num_worlds, controls, steps=30):
    return np.random.default_rng(1).uniform(-1, 1, (steps, num_worlds, controls))


def planar_scene():
    return robot_scene(robots.planar_point())


def different_starts(scene, num_worlds):
    start = home_start(scene, num_worlds)
    start.joint_velocity[:] = np.random.default_rng(2).normal(size=start.joint_velocity.shape)
    return start


def play(world, tape):
    for control in tape:
        world.step(control, 3)
    return world.state()


def test_no_declared_gap_is_stale():
    of_ant = {item.name.partition(":")[0]: item for item in robot_checks(load_robot("ant"))}
    found = {name: run_check(backend, of_ant[name] if name in OF_ROBOTS else find(name)).status for name in GAPS}
    assert found == dict.fromkeys(GAPS, "gap")


def test_worlds_that_share_a_scene_move_as_if_alone():
    scene, count = planar_scene(), WORLDS_PER_SCENE + 3
    tape = noise(count, len(scene.robot.actuators))
    start = different_starts(scene, count)
    together = backend.build(scene, count)
    together.reset(np.ones(count, bool), start)
    assert len({id(copy.scene) for copy in together._fleet.copies}) == 2
    state = play(together, tape)
    for world in (0, 7, WORLDS_PER_SCENE - 1, WORLDS_PER_SCENE, count - 1):
        alone = backend.build(scene, 1)
        row = {name: getattr(start, name)[world : world + 1] for name in start.__dataclass_fields__}
        alone.reset(np.ones(1, bool), type(start)(**row))
        single = play(alone, tape[:, world : world + 1])
        for name in MOTION:
            assert np.array_equal(getattr(state, name)[world], getattr(single, name)[0]), name


@pytest.mark.parametrize("poison", ["control", "start", "blow up"])
def test_a_lost_world_in_a_shared_scene_freezes_alone_and_recovers_exactly(poison):
    scene, count, lost = planar_scene(), 5, 2
    tape = noise(count, len(scene.robot.actuators))
    others = np.arange(count) != lost
    healthy, hurt = backend.build(scene, count), backend.build(scene, count)
    start = different_starts(scene, count)
    for world in (healthy, hurt):
        world.reset(np.ones(count, bool), start)
        play(world, tape[:5])
    bad = tape[5].copy()
    if poison == "control":
        bad[lost] = np.nan
    else:
        bad_start = different_starts(scene, count)
        bad_start.joint_velocity[lost] = np.nan if poison == "start" else 3e38
        hurt.reset(~others, bad_start)
    healthy.step(tape[5], 3)
    hurt.step(bad, 3)
    hurt_state = hurt.state()
    assert poison == "blow up" or not hurt_state.ok[lost]
    assert not differing(play(healthy, tape[6:]), play(hurt, tape[6:]), worlds=others)
    if poison != "blow up":
        assert not differing(hurt_state, hurt.state(), worlds=[lost])
    fresh = backend.build(scene, count)
    for world in (fresh, hurt):
        world.reset(np.ones(count, bool), start)
    assert not differing(play(fresh, tape), play(hurt, tape))


def test_a_snapshot_keeps_lost_worlds_lost_and_the_others_moving():
    scene = planar_scene()
    tape = noise(3, len(scene.robot.actuators))
    with running(backend, scene, 3) as world, running(backend, scene, 3) as other:
        play(world, tape)
        bad = tape[0].copy()
        bad[1] = np.inf
        world.step(bad, 1)
        blob, there = world.snapshot(), world.state()
        other.restore(blob)
        assert not differing(there, other.state(), ("ok", "time", "joint_position", "joint_velocity"))
        first = play(other, tape)
        other.restore(blob)
        assert not differing(first, play(other, tape))
        assert first.ok.tolist() == [True, False, True]


def test_a_world_that_blew_up_in_contact_is_rebuilt():
    scene = bodies_scene(("box", body(), 1), robot=pusher())
    place = {"body_position": (0.4, 0.0, 0.1)}
    with running(backend, scene, 2, **place) as world, running(backend, scene, 2, **place) as fresh:
        engine = world._fleet.copies[0].robot.engine
        engine.set_qvel(np.full(1, np.nan, np.float32))
        world.step(idle(world), 2)
        assert world.state().ok.tolist() == [False, True]
        world.reset(np.ones(2, bool), rest_start(scene, 2, **place))
        for each in (world, fresh):
            each.reset(np.ones(2, bool), rest_start(scene, 2, **place))
            each.step(idle(each), 20)
        assert not differing(world.state(), fresh.state())


def test_virtual_links_weigh_a_billionth_of_the_robot():
    robot = tree("planar")
    with running(backend, robot_scene(robot)) as world:
        held = world.inspect(0)
    total = sum(link.mass for link in robot.links)
    assert held.link_mass[1:3] == pytest.approx(1e-9 * total, rel=1e-6)
    assert held.link_mass.sum() == pytest.approx(total, rel=1e-6)


def test_no_engine_default_is_left_on_the_robot():
    robot = tree(damping=0.3, armature=0.2, friction_loss=0.1)
    scene = robot_scene(robot)
    with running(backend, scene) as world:
        art = world._fleet.copies[0].robot
        assert art.engine.sleep_threshold == 0
        for link in art.links:
            assert link.linear_damping == link.angular_damping == 0
            assert min(link.max_linear_velocity, link.max_angular_velocity) >= 1e6
        for joint in art.joints:
            assert joint.friction == 0
            assert joint.max_velocity >= 1e6
            assert joint.get_armature()[0] == pytest.approx(0.2 + scene.timestep * 0.3)
            assert (joint.stiffness, joint.force_limit) == (0, pytest.approx(0.1))


@pytest.mark.parametrize(("low", "high"), [(0.1, 0.7), (0.4, 0.4)])
def test_friction_of_unequal_pairs_is_guards_and_not_the_average(low, high):
    """A box of friction `high` sliding on a slab of friction `low`: the larger decides; the slab's own on the floor."""
    slab = body(friction=low, half=0.5, mass=1e4)
    scene = bodies_scene(("slab", slab, 1), ("box", body(friction=high), 1), ("other", body(friction=low), 1))
    place = [[(0, 0, 0.5), (0, 0, 1.1), (0, 5, 0.1)]]
    speed = [[(0, 0, 0), (2.0, 0, 0), (2.0, 0, 0)]]
    with running(backend, scene, 1, body_position=place, body_linear_velocity=speed) as world:
        world.step(idle(world), 100)
        lost = 2.0 - world.state().body_linear_velocity[0, 1:, 0]
        assert not world.approximations
    assert lost == pytest.approx(np.array([high, low]) * 9.81 * 0.2, rel=0.01)


def test_seven_frictions_are_reported_as_an_approximation():
    groups = [(f"g{i}", body(friction=0.1 * (i + 1)), 1) for i in range(7)]
    with running(backend, bodies_scene(*groups), body_position=[[(i, 0, 0.1) for i in range(7)]]) as world:
        assert "7" in world.approximations[0]


def test_cylinders_are_reported_as_an_approximation():
    cylinder = replace(body(), shape=Cylinder(radius=0.1, half_length=0.1))
    with running(backend, bodies_scene(("rollers", cylinder, 1)), body_position=(0, 0, 0.1)) as world:
        assert "'rollers'" in world.approximations[0]


def test_links_either_side_of_massless_ones_do_not_collide():
    """The two ends of a chain over virtual links overlap: they would be thrown apart, were they not exempt."""
    robot = tree("planar")
    ball = (Collision(shape=Sphere(radius=0.4)),)  # the frames are 0.5 m apart
    solid = replace(robot.links[-1], name="world_base", collisions=ball)
    links = [replace(link, collisions=ball if link.name == "trunk" else ()) for link in robot.links[1:]]
    scene = robot_scene(replace(robot, links=(solid, *links)))
    with running(backend, scene) as world:
        world.step(idle(world), 20)
        assert np.abs(world.state().joint_velocity).max() < 1e-6


def test_native_keeps_the_engines_contacts_but_not_its_robot_defaults():
    scene = bodies_scene(("box", body(friction=0.5), 1), preset="native")
    speed = {"body_position": (0, 0, 0.1), "body_linear_velocity": (2.0, 0, 0)}
    with running(backend, scene, 1, **speed) as world:
        world.step(idle(world), 100)
        lost = 2.0 - world.state().body_linear_velocity[0, 0, 0]
    assert lost == pytest.approx((0.5 + 0.3) / 2 * 9.81 * 0.2, rel=0.02)  # the average with SAPIEN's ground


def test_mean_touch_of_a_resting_box_is_its_weight():
    """TGS with many iterations would report two thirds of it."""
    robot = loose_link(collisions=(Collision(shape=Box(half_extents=(0.1, 0.1, 0.1))),))
    with running(backend, bodies_scene(robot=robot), base_position=(0, 0, 0.1)) as world:
        world.step(idle(world), 100)
        world.step(idle(world), 100)
        assert world.state().touch[0, 0] == pytest.approx(2.0 * 9.81, rel=1e-3)


@pytest.mark.parametrize(
    ("group", "match"),
    [
        (body(mass=0.0), "mass > 0"),
        (replace(body(), shape=Sphere(radius=-1.0)), "positive"),
        (body("phantom"), "phantom"),
    ],
)
def test_what_physx_would_silently_replace_is_refused(group, match):
    with pytest.raises(BackendError, match=match):
        backend.build(bodies_scene(("wrong", group, 1)), 1)


def test_close_twice():
    world = backend.build(planar_scene(), 2)
    world.close()
    world.close()
