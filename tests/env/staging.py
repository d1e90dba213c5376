"""Put the robot and the objects of a real environment where a test wants them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guard_api.env import Environment
from guard_api.scene.start import home_start, place_robot
from guard_api.spec import EnvSpec
from guard_api.suite import make_spec


def spec_with(name: str, **changes: object) -> EnvSpec:
    """The specification called `name` with other fields."""
    return replace(make_spec(name), **changes)


def put(env: Environment, xy: np.ndarray, yaw: float | np.ndarray = 0.0, **places: np.ndarray) -> None:
    """Start every world anew: the robot at `xy` (N or 1, 2), groups at `places` (N or 1, count, 2 or 3), unturned.

    Groups without a place and heights without a number stay as the layout has them.
    """
    env.reset()
    start = home_start(env.scene, env.num_worlds)
    xy = np.broadcast_to(xy, (env.num_worlds, 2))
    start = place_robot(env.robot, start, xy, np.broadcast_to(yaw, env.num_worlds))
    for group in env.groups:
        placed = env._positions[group.name].copy()
        if group.name in places:
            given = np.asarray(places[group.name])
            placed[..., : given.shape[-1]] = given
        env._positions[group.name] = env._origins[group.name] = placed
        if group.body.physics != "phantom":
            start.body_position[:, env.scene.body_slice(group.name)] = placed
    env.world.reset(np.ones(env.num_worlds, dtype=bool), start)
    env._now = env._snapshot(env.world.state())


def drive(env: Environment, action: tuple[float, float], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Take the same action again and again; return rewards (steps, N) and costs (steps, N, C)."""
    actions = np.broadcast_to(np.array(action), (env.num_worlds, env.action_size))
    taken = [env.step(actions) for _ in range(steps)]
    return np.array([step.reward for step in taken]), np.array([step.costs for step in taken])
