"""Forward kinematics against a plain recursion, velocities against finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from guard_api import rotations
from guard_api.model.kinematics import Kinematics
from guard_api.model.robot import RobotModel
from guard_api.testing import robots

ROBOTS = [robots.double_pendulum, robots.slider, robots.three_link_arm, robots.planar_point, robots.floating_body,
          robots.floating_tree]  # fmt: skip
Builder = Callable[[], RobotModel]


def random_motion(robot: RobotModel, num_worlds: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    quaternion = rng.normal(size=(num_worlds, 4))
    return {
        "position": rng.normal(size=(num_worlds, 3)),
        "quaternion": quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        "linear": rng.normal(size=(num_worlds, 3)),
        "angular": rng.normal(size=(num_worlds, 3)),
        "q": rng.normal(size=(num_worlds, len(robot.joints))),
        "qd": rng.normal(size=(num_worlds, len(robot.joints))),
    }


def one_by_one(robot: RobotModel, position: np.ndarray, quaternion: np.ndarray, q: np.ndarray) -> list[np.ndarray]:
    """Positions and quaternions of all links of one world, joint by joint in model order."""
    positions, quaternions = [position], [quaternion]
    for joint, value in zip(robot.joints, q, strict=True):
        parent = robot.link_index(joint.parent)
        place = positions[parent] + rotations.rotate(quaternions[parent], joint.origin.position)
        turn = rotations.multiply(quaternions[parent], joint.origin.quaternion)
        if joint.kind == "prismatic":
            place = place + rotations.rotate(turn, np.array(joint.axis) * value)
        else:
            turn = rotations.multiply(turn, rotations.from_axis_angle(joint.axis, value))
        positions.append(place)
        quaternions.append(turn)
    return [np.array(positions), np.array(quaternions)]


@pytest.mark.parametrize("build", ROBOTS)
def test_poses_match_a_plain_recursion(build: Builder) -> None:
    robot = build()
    motion = random_motion(robot, 5)
    poses = Kinematics(robot).poses(motion["position"], motion["quaternion"], motion["q"])
    for i in range(5):
        expected = one_by_one(robot, motion["position"][i], motion["quaternion"][i], motion["q"][i])
        np.testing.assert_allclose(poses.position[i], expected[0], atol=1e-14)
        np.testing.assert_allclose(poses.quaternion[i], expected[1], atol=1e-14)


@pytest.mark.parametrize("build", ROBOTS)
def test_velocities_are_the_derivatives_of_poses(build: Builder) -> None:
    robot = build()
    kinematics, motion = Kinematics(robot), random_motion(robot, 5)
    poses = kinematics.poses(motion["position"], motion["quaternion"], motion["q"])
    linear, angular = kinematics.velocities(poses, motion["linear"], motion["angular"], motion["qd"])

    h = 1e-6
    rate = np.linalg.norm(motion["angular"], axis=1)

    def later(time: float):
        turn = rotations.from_axis_angle(motion["angular"] / rate[:, None], rate * time)
        return kinematics.poses(
            motion["position"] + time * motion["linear"],
            rotations.multiply(turn, motion["quaternion"]),
            motion["q"] + time * motion["qd"],
        )

    after, before = later(h), later(-h)
    np.testing.assert_allclose(linear, (after.position - before.position) / (2 * h), atol=1e-8)
    spin = rotations.multiply((after.quaternion - before.quaternion) / h, rotations.conjugate(poses.quaternion))
    np.testing.assert_allclose(angular, spin[..., 1:], atol=1e-8)


@pytest.mark.parametrize(
    "links",
    [("right_lower",), ("left_lower", "left_upper"), ("body",), ("right_upper", "left_upper", "body")],
)
def test_a_subset_of_links_repeats_the_rows_of_the_whole(links: tuple[str, ...]) -> None:
    robot = robots.floating_tree()
    motion = random_motion(robot, 4)
    rows = [robot.link_index(name) for name in links]
    results = []
    for kinematics in (Kinematics(robot), Kinematics(robot, links)):
        poses = kinematics.poses(motion["position"], motion["quaternion"], motion["q"])
        velocities = kinematics.velocities(poses, motion["linear"], motion["angular"], motion["qd"])
        results.append((poses.position, poses.quaternion, *velocities))
    for whole, part in zip(*results, strict=True):
        assert whole[:, rows].tobytes() == part.tobytes()


def test_a_subset_computes_only_ancestors() -> None:
    robot = robots.floating_tree()
    order = Kinematics(robot, ["right_lower"]).order
    assert [robot.links[index].name for index in order] == ["body", "right_upper", "right_lower"]


def test_an_unknown_link_is_refused() -> None:
    with pytest.raises(ValueError, match="not in tuple"):
        Kinematics(robots.pendulum(), ["bobb"])
