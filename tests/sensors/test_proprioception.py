"""What a robot's own sensors read, on its state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from guard_api.model.library import load_robot
from guard_api.model.robot import Sensor
from guard_api.physics.state import State, state_dtype, state_shapes
from guard_api.physics.transition import SnapshotReader, Transition
from guard_api.scene.spec import SceneSpec
from guard_api.sensors.inertial import InertialSensors
from guard_api.sensors.proprioception import Proprioception
from guard_api.testing.robots import touch_sensor
from guard_api.testing.scenes import tree


def transition(robot, num_worlds=3, seed=0):
    """A standstill in a state of random numbers."""
    rng = np.random.default_rng(seed)
    shapes = state_shapes(SceneSpec(robot=robot), num_worlds)
    arrays = {name: rng.normal(size=shape).astype(state_dtype(name)) for name, shape in shapes.items()}
    arrays["link_quaternion"] /= np.linalg.norm(arrays["link_quaternion"], axis=-1, keepdims=True)
    rest = {"bodies": {}, "origins": {}, "slices": {}, "steps_since_success": np.zeros(num_worlds, np.int64)}
    now = SnapshotReader(robot).read(State(**arrays), **rest)
    return Transition(previous=now, now=now, action=np.zeros((num_worlds, 1)), duration=0.02)


def test_joints_and_touch_are_read_by_name():
    """Sensors in an order of their own, of joints of every kind."""
    robot = tree("fixed")
    joints = {joint.name: joint for joint in robot.joints}
    order = sorted(joints)
    robot = replace(robot, sensors=(
        *(Sensor(name=f"position_{name}", kind="joint_position", joint=name) for name in order),
        touch_sensor("beta"), touch_sensor("zeta", radius=0.1),
        *(Sensor(name=f"velocity_{name}", kind="joint_velocity", joint=name) for name in order),
    ))  # fmt: skip
    t = transition(robot)
    readings, state = Proprioception(robot).read(t), t.now.state
    assert set(readings) == {sensor.name for sensor in robot.sensors}
    assert {joint.kind for joint in joints.values()} == {"revolute", "continuous", "prismatic"}
    for index, (name, joint) in enumerate(joints.items()):
        q = state.joint_position[:, index]
        expected = [q] if joint.kind == "prismatic" else [np.sin(q), np.cos(q)]
        np.testing.assert_array_equal(readings[f"position_{name}"], np.stack(expected, axis=1))
        np.testing.assert_array_equal(readings[f"velocity_{name}"], state.joint_velocity[:, [index]])
    np.testing.assert_array_equal(readings["touch_beta"], state.touch[:, [0]])
    np.testing.assert_array_equal(readings["touch_zeta"], state.touch[:, [1]])


def test_each_sensor_is_read_once():
    robot = load_robot("ant")
    t = transition(robot)
    feels, moves = Proprioception(robot).read(t), InertialSensors(robot).read(t)
    assert feels.keys().isdisjoint(moves)
    assert feels.keys() | moves.keys() == {sensor.name for sensor in robot.sensors}
    assert not Proprioception(load_robot("point")).read(transition(load_robot("point")))


@pytest.mark.parametrize("kind", ["relative_rotation", "relative_angular_velocity", "joint_position"])
def test_a_world_reads_the_same_bits_alone(kind):
    robot = tree("floating")
    place = {"joint": robot.joints[0].name} if kind == "joint_position" else {"link": "beta"}
    robot = replace(robot, sensors=(Sensor(name="it", kind=kind, **place),))
    many = transition(robot, 17)
    arrays = {name: getattr(many.now.state, name)[5:6] for name in State.__dataclass_fields__}
    rest = {"bodies": {}, "origins": {}, "slices": {}, "steps_since_success": np.zeros(1, np.int64)}
    now = SnapshotReader(robot).read(State(**arrays), **rest)
    one = Transition(previous=now, now=now, action=np.zeros((1, 1)), duration=0.02)
    sensors = Proprioception(robot)
    assert sensors.read(one)["it"].tobytes() == sensors.read(many)["it"][5:6].tobytes()
