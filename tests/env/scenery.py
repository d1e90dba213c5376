"""Snapshots made by hand, so that tasks, constraints and sensors are tested without any physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guard_api.physics.state import State, state_dtype, state_shapes
from guard_api.physics.transition import Snapshot, Transition
from guard_api.rotations import to_matrix, yaw_quaternion
from guard_api.scene.spec import SceneSpec


def snapshot(xy: np.ndarray, yaw: np.ndarray, **bodies: np.ndarray) -> Snapshot:
    """A robot of one link at `xy` (N, 2), heading `yaw` (N,), among `bodies` name -> (N, count, 2 or 3)."""
    n = len(xy)
    shapes = state_shapes(SceneSpec(robot=None), n)
    arrays = {name: np.zeros(shape, dtype=state_dtype(name)) for name, shape in shapes.items()}
    for name in ("link_position", "link_linear_velocity", "link_angular_velocity"):
        arrays[name] = np.zeros((n, 1, 3))
    arrays["link_position"][:, 0, :2] = xy
    arrays["link_position"][:, 0, 2] = 0.1
    arrays["link_quaternion"] = yaw_quaternion(yaw)[:, None]
    state = State(**arrays)
    placed = {name: np.concatenate([p, np.zeros((*p.shape[:2], 3 - p.shape[2]))], -1) for name, p in bodies.items()}
    return Snapshot(
        state=state,
        position=state.link_position[:, 0],
        rotation=to_matrix(state.link_quaternion[:, 0]),
        linear_velocity=state.link_linear_velocity[:, 0],
        angular_velocity=state.link_angular_velocity[:, 0],
        sensing_position=state.link_position,
        sensing_rotation=to_matrix(state.link_quaternion),
        segment_start=np.zeros((n, 0, 3)),
        segment_end=np.zeros((n, 0, 3)),
        segment_radius=np.zeros(0),
        bodies=placed,
        origins=placed,
        slices={},
        steps_since_success=np.zeros(n, dtype=np.int64),
    )


def touching(now: Snapshot, group: str, contact: list[list[bool]], velocity: np.ndarray | None = None) -> Snapshot:
    """The same instant with a physical `group`, whose bodies the robot touches or not; at rest unless `velocity`."""
    touched = np.array(contact)
    still = np.zeros((*touched.shape, 3))
    state = replace(now.state, body_contact=touched, body_linear_velocity=still if velocity is None else velocity)
    return replace(now, state=state, slices={group: slice(0, touched.shape[1])})


def at_rest(now: Snapshot) -> Transition:
    return Transition(previous=now, now=now, action=np.zeros((len(now.position), 2)), duration=0.02)


def moved(now: Snapshot, by: tuple[float, float]) -> Transition:
    """A step that ends in `now` and began `by` [m] short of it."""
    previous = replace(now, position=now.position - np.array([*by, 0.0]))
    return replace(at_rest(now), previous=previous)
