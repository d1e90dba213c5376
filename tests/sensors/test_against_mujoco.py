"""GUARD's sensors beside MuJoCo's own, on the same motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from guard_api import rotations
from guard_api.conventions import MAGNETIC_FIELD
from guard_api.model.library import load_robot
from guard_api.model.robot import Joint, Link, RobotModel, Sensor
from guard_api.physics.state import State, state_dtype, state_shapes
from guard_api.physics.transition import SnapshotReader, Transition
from guard_api.scene.spec import SceneSpec
from guard_api.scene.start import home_start
from guard_api.sensors.inertial import InertialSensors
from guard_api.sensors.proprioception import Proprioception
from guard_api.shapes import Pose
from guard_api.testing.robots import ant, touch_sensor
from guard_api.testing.scenes import tree

mujoco = pytest.importorskip("mujoco")
guard_mujoco = pytest.importorskip("guard_mujoco")
from guard_mujoco.compile import _specify  # noqa: E402

TURN = tuple((np.array([0.7, -0.1, 0.5, 0.3]) / np.linalg.norm([0.7, -0.1, 0.5, 0.3])).tolist())
INERTIAL = {"accelerometer": "ACCELEROMETER", "velocimeter": "VELOCIMETER", "gyro": "GYRO",
            "magnetometer": "MAGNETOMETER"}  # fmt: skip


def with_inertial_sensors(robot, links):
    places = [Pose(position=(0.1, -0.2, 0.3 - 0.1 * i), quaternion=TURN) for i in range(len(links))]
    sensors = [Sensor(name=f"{kind}_{link}", kind=kind, link=link, pose=place)
               for link, place in zip(links, places, strict=True) for kind in INERTIAL]  # fmt: skip
    return replace(robot, sensors=(*robot.sensors, *sensors))


def original(scene):
    """MuJoCo's model of a scene, with the engine's own sensors for those of the robot, in their order."""
    spec = _specify(replace(scene, robot=replace(scene.robot, sensors=())))
    spec.option.magnetic = MAGNETIC_FIELD
    for sensor in scene.robot.sensors:
        size = [sensor.radius] * 3 if sensor.kind == "touch" else [0.01] * 3
        site = spec.body(f"link/{sensor.link}").add_site(
            name=sensor.name, pos=sensor.pose.position, quat=sensor.pose.quaternion, size=size
        )
        kind = getattr(mujoco.mjtSensor, f"mjSENS_{INERTIAL.get(sensor.kind, sensor.kind).upper()}")
        spec.add_sensor(name=sensor.name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site.name)
    return spec.compile()


def snapshot(robot, state):
    rest = {"bodies": {}, "origins": {}, "slices": {}, "steps_since_success": np.zeros(len(state.ok), np.int64)}
    return SnapshotReader(robot).read(state, **rest)


def run(scene, start, control, substeps, steps=1):
    """Return GUARD's readings of the last step, and the engine's own after it and in each of its substeps."""
    robot = scene.robot
    world = guard_mujoco.backend.build(scene, 1)
    world.reset(np.ones(1, bool), start)
    for _ in range(steps - 1):
        world.step(control, substeps)
    before = world.state()
    model = original(scene)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = world._batch.bind("qpos")[0], world._qvel[0], control[0]
    data.qacc_warmstart[:] = world._batch.get_data(0).qacc_warmstart
    world.step(control, substeps)
    t = Transition(previous=snapshot(robot, before), now=snapshot(robot, world.state()), action=control,
                   duration=substeps * scene.timestep)  # fmt: skip
    each = []
    for _ in range(substeps):
        mujoco.mj_step(model, data)
        frames = {s.name: data.site(s.name).xmat.reshape(3, 3).copy() for s in robot.sensors}
        each.append(({s.name: data.sensor(s.name).data.copy() for s in robot.sensors}, frames))
    mujoco.mj_forward(model, data)
    after = {s.name: (data.sensor(s.name).data.copy(), data.site(s.name).xmat.reshape(3, 3)) for s in robot.sensors}
    return InertialSensors(robot).read(t) | Proprioception(robot).read(t), after, each


def tumbling(timestep, substeps):
    robot = with_inertial_sensors(tree("floating"), ("trunk", "kappa", "beta"))
    scene = SceneSpec(robot=robot, ground=False, timestep=timestep)
    start = home_start(scene, 1)
    rng = np.random.default_rng(3)
    start = replace(start, base_linear_velocity=rng.normal(size=(1, 3)), base_angular_velocity=rng.normal(size=(1, 3)),
                    joint_velocity=rng.normal(size=(1, len(robot.joints))))  # fmt: skip
    return robot, *run(scene, start, 10.0 * rng.normal(size=(1, len(robot.actuators))), substeps)


def test_velocity_turn_and_field_are_the_engines():
    robot, readings, after, _ = tumbling(0.002, 10)
    for sensor in robot.sensors:
        if sensor.kind != "accelerometer":
            np.testing.assert_allclose(readings[sensor.name][0], after[sensor.name][0], atol=1e-12, rtol=0)


def test_acceleration_is_the_mean_of_the_engines():
    robot, readings, after, each = tumbling(2e-5, 10)
    for sensor in robot.sensors:
        if sensor.kind == "accelerometer":
            inside = [frames[sensor.name] @ values[sensor.name] for values, frames in each]
            mean = after[sensor.name][1].T @ np.mean(inside, axis=0)
            assert np.linalg.norm(mean) > 5.0  # m/s^2, as the check needs
            np.testing.assert_allclose(readings[sensor.name][0], mean, atol=1e-3 * np.linalg.norm(mean), rtol=0)


def test_touch_is_the_mean_of_the_engines():
    """An ant that struggles on the floor; with spheres so small that one foot feels less than its whole shin."""
    robot = ant()
    feet = [f"shin_{k}" for k in range(1, 5)]
    ends = dict(zip(feet, ((1, 1), (-1, 1), (-1, -1), (1, -1)), strict=True))
    tips = [touch_sensor(foot, place=(0.1 * x, 0.1 * y, 0.0), radius=0.03, name="tip") for foot, (x, y) in ends.items()]
    shins = [touch_sensor(foot, radius=0.2, name="shin") for foot in feet]
    robot = replace(robot, sensors=(*shins, *tips))
    scene = SceneSpec(robot=robot, timestep=0.002)
    control = np.array([[0.5, -1.0, -0.4, 1.0, 0.3, -0.7, 0.2, 0.6]])
    readings, _, each = run(scene, home_start(scene, 1), control, substeps=10, steps=40)
    own = {s.name: np.mean([values[s.name][0] for values, _ in each]) for s in robot.sensors}
    assert sum(value > 0.0 for value in own.values()) >= 2
    for name, value in own.items():
        assert readings[name][0] == pytest.approx([value], abs=1e-9), name


@pytest.mark.parametrize("name", ["ant", "arm6", "car", "doggo", "hopper", "humanoid", "swimmer", "walker"])
def test_sensors_of_shipped_robots_are_the_engines(name):
    """Velocity, turn, field and touch, where each robot has them, at its own timestep, moving on the ground.

    Not Drone, whose controls GUARD turns into forces before the engine sees them.
    """
    robot = load_robot(name)
    own = tuple(s for s in robot.sensors if s.kind in {*INERTIAL, "touch"} and s.kind != "accelerometer")
    robot = replace(robot, sensors=own)
    scene = SceneSpec(robot=robot, timestep=robot.timestep)
    control = np.random.default_rng(2).uniform(-1.0, 1.0, (1, len(robot.actuators)))
    readings, after, each = run(scene, home_start(scene, 1), control, robot.substeps, steps=3)
    for sensor in own:
        mean = np.mean([values[sensor.name] for values, _ in each], axis=0)
        expected = mean if sensor.kind == "touch" else after[sensor.name][0]
        np.testing.assert_allclose(readings[sensor.name][0], expected, rtol=1e-9, atol=1e-9, err_msg=sensor.name)
    assert any(np.abs(readings[sensor.name]).max() > 1e-3 for sensor in own)


BALL = """
<mujoco><worldbody><body name="hull"><freejoint/><geom size="0.1" mass="1"/>
  <body name="wheel" pos="0.3 0 0"><joint name="ball" type="ball"/><geom size="0.1" mass="1" pos="0.1 0 0"/></body>
</body></worldbody><sensor><ballquat joint="ball"/><ballangvel joint="ball"/></sensor></mujoco>"""


def test_relative_rotation_and_spin_are_a_ball_joints():
    """The model has three hinges and two virtual links where MuJoCo has a ball."""
    hull, wheel = Link(name="hull", mass=1.0), Link(name="wheel", mass=1.0)
    chain = ["hull", "one", "two", "wheel"]
    joints = tuple(Joint(name=f"turn_{b}", kind="continuous", parent=a, child=b)
                   for a, b in pairwise(chain))  # fmt: skip
    sensors = tuple(
        Sensor(name=kind, kind=f"relative_{kind}", link="wheel") for kind in ("rotation", "angular_velocity")
    )
    robot = RobotModel(
        name="cart", base="floating", root="hull", joints=joints, actuators=(), sensors=sensors,
        links=(hull, Link(name="one", mass=0.0), Link(name="two", mass=0.0), wheel),
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    data.qvel[:] = rng.normal(size=9)
    for first in (3, 7):
        data.qpos[first : first + 4] = rng.normal(size=4)
    mujoco.mj_normalizeQuat(model, data.qpos)
    mujoco.mj_forward(model, data)
    arrays = {
        name: np.zeros(shape, state_dtype(name)) for name, shape in state_shapes(SceneSpec(robot=robot), 1).items()
    }
    arrays["link_quaternion"][..., 0] = 1.0
    for link, body in ((0, "hull"), (3, "wheel")):
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, data.body(body).id, velocity, 0)
        arrays["link_quaternion"][0, link] = data.body(body).xquat
        arrays["link_angular_velocity"][0, link] = velocity[:3]
    now = snapshot(robot, State(**arrays))
    at_rest = Transition(previous=now, now=now, action=np.zeros((1, 0)), duration=0.01)
    readings = InertialSensors(robot).read(at_rest) | Proprioception(robot).read(at_rest)
    rotation = rotations.to_matrix(data.sensordata[:4])
    np.testing.assert_allclose(readings["rotation"], rotation.reshape(1, 9), atol=1e-14)
    np.testing.assert_allclose(readings["angular_velocity"], data.sensordata[None, 4:], atol=1e-14)
