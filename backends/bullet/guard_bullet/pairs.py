"""Which links of one robot can touch each other."""

from __future__ import annotations

from guard_api.model.robot import RobotModel


def connected(robot: RobotModel) -> set[frozenset[int]]:
    """Return the pairs of model links that a joint connects, directly or through virtual links only.

    Such pairs overlap by construction and never collide.
    """
    parent = {robot.link_index(joint.child): robot.link_index(joint.parent) for joint in robot.joints}
    pairs = set()
    for child, joint_parent in parent.items():
        link = joint_parent
        pairs.add(frozenset((child, link)))
        while robot.links[link].virtual and link in parent:
            link = parent[link]
            pairs.add(frozenset((child, link)))
    return pairs


def self_collides(robot: RobotModel) -> bool:
    """Return whether two links of `robot` can touch each other."""
    solid = [i for i, link in enumerate(robot.links) if link.collisions]
    pairs = connected(robot)
    return any(frozenset((a, b)) not in pairs for a in solid for b in solid if a < b)
