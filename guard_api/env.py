"""The environment: the only place where a task is stepped. Batched over N worlds, on any backend.

It conducts and computes nothing itself: physics is the world's, rewards the task's, costs the constraints', places the
episode starter's. The order within a step is: physics, reward and costs, respawn, observation, end of episodes, reset.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from guard_api import plugins
from guard_api.errors import SpecError
from guard_api.model.library import load_robot, side_file
from guard_api.model.robot import RobotModel
from guard_api.physics.actuation import control_of
from guard_api.physics.build import build_world
from guard_api.physics.state import Array, Mask, State
from guard_api.physics.transition import Snapshot, SnapshotReader, Transition
from guard_api.scene.episode import EpisodeStarter
from guard_api.scene.spec import BodyGroup, SceneSpec
from guard_api.sensors.inertial import InertialSensors
from guard_api.sensors.proprioception import Proprioception
from guard_api.spec import EnvSpec
from guard_api.suite import make_spec

FAILURE_REWARD: Final = -10.0
"""Reward of a step in which a world diverged. Source: GUARD's `reward_exception`."""

FAILURE_COST: Final = 1.0
"""Cost of such a step, in every column, so that breaking the simulator never pays. Source: GUARD's `cost_exception`."""

NEVER: Final = 1 << 30
"""`Snapshot.steps_since_success` of a world that has not achieved its task yet in the episode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What one step of N worlds gave; C constraints, O observation numbers.

    observation: (N, O), of the next episode where one ended. final_observation: (N, O), the last one of the episode
    that the step belongs to; equal to `observation` where none ended.
    reward: (N,). costs: (N, C) >= 0, columns as `Environment.cost_names`.
    terminated: (N,) ended by a failure. truncated: (N,) ended by the time limit. success: (N,) the task was achieved.
    failures: world -> reason, for the terminated ones.
    """

    observation: Array
    reward: Array
    costs: Array
    terminated: Mask
    truncated: Mask
    final_observation: Array
    success: Mask
    failures: dict[int, str]


class Environment:
    """N worlds of one specification on one backend; a step takes `duration` [s] of simulated time.

    Raises SpecError or BackendError from the constructor when the two do not fit.
    """

    def __init__(
        self, spec: EnvSpec, *, backend: str, num_worlds: int = 1, seed: int = 0, workers: int | None = None
    ) -> None:
        if num_worlds < 1:
            raise SpecError(f"num_worlds is {num_worlds}: it must be at least 1")
        self.spec, self.backend_name, self.num_worlds, self.seed = spec, backend, num_worlds, _checked(seed)
        self.robot = _actuated(spec.robot)
        self._groups = spec.groups
        self.scene = SceneSpec(
            robot=self.robot,
            groups=tuple(group for group in self._groups if group.body.physics != "phantom"),
            timestep=self.robot.timestep,
            preset=spec.preset,
        )
        self.substeps = self.robot.substeps
        self.duration = self.substeps * self.robot.timestep
        self.episode_length = spec.episode_length
        self.cost_names = tuple(constraint.name for constraint in spec.constraints)
        self.action_size = len(self.robot.actuators)
        self._control = control_of(self.robot)
        self._starter = EpisodeStarter(self.scene, self._groups, spec.extents, num_worlds, spec.robot_placement)
        sensors = (InertialSensors(self.robot), Proprioception(self.robot))
        self._sensors = tuple(kind for kind in sensors if kind.any)
        self._reader = SnapshotReader(self.robot)
        self._slices = {group.name: self.scene.body_slice(group.name) for group in self.scene.groups}
        self.world = build_world(plugins.load("guard.backends", backend), self.scene, num_worlds, workers)

        self._everywhere = np.ones(num_worlds, dtype=bool)
        self._episode, self._steps = np.zeros((2, num_worlds), dtype=np.int64)
        self._since_success = np.full(num_worlds, NEVER)
        self._positions: dict[str, Array] = {}
        self._origins: dict[str, Array] = {}
        self._now = self._begin(self._everywhere)
        self.observation_layout = self._layout()
        self.observation_size = sum(part.stop - part.start for part in self.observation_layout.values())

    @property
    def groups(self) -> tuple[BodyGroup, ...]:
        """Every body group of the specification, phantoms included."""
        return self._groups

    @property
    def snapshot(self) -> Snapshot:
        """The present instant of every world: what tasks, constraints and pictures are made from."""
        return self._now

    def reset(self, episode: int = 0, seed: int | None = None) -> Array:
        """Start every world at the beginning of its episode number `episode`; return the observations (N, O).

        seed: replaces the environment's seed. The same seed and episode give the same start on every backend.
        """
        if seed is not None:
            self.seed = _checked(seed)
        self._episode[:] = episode
        self._now = self._begin(self._everywhere)
        return self._observe(self._standstill(self._now))

    def step(self, action: NDArray[np.floating]) -> Step:
        """Advance every world by one step under `action` (N, A), clipped to [-1, 1]: the ends of the control ranges.

        One that is not finite fails its world. Worlds whose episode ended start their next one in the same step.
        """
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (self.num_worlds, self.action_size):
            raise SpecError(f"action has shape {action.shape}: expected {(self.num_worlds, self.action_size)}")
        t, failures = self._advance(action)
        reward, costs, success = self.spec.task.reward(t), self._costs(t), self.spec.task.reached(t)
        if failures:
            failed = list(failures)
            reward[failed], costs[failed], success[failed] = FAILURE_REWARD, FAILURE_COST, False
        if np.count_nonzero(success):
            reward[success] += self.spec.task.bonus
            t = self._respawn(t, success, failures)
        terminated = np.zeros(self.num_worlds, dtype=bool)
        truncated = self._steps >= self.episode_length
        if failures:
            terminated[list(failures)], truncated[list(failures)] = True, False

        final = observation = self._observe(t)
        ended = terminated | truncated
        if np.count_nonzero(ended):
            self._episode[ended] += 1
            self._now = self._begin(ended)
            # A transition with itself reads as standstill for new episodes; the others keep their true reading.
            observation = np.where(ended[:, None], self._observe(self._standstill(self._now)), final)
        return Step(
            observation=observation,
            reward=reward,
            costs=costs,
            terminated=terminated,
            truncated=truncated,
            final_observation=final,
            success=success,
            failures=failures,
        )

    def close(self) -> None:
        """Release the world."""
        self.world.close()

    def _advance(self, action: Array) -> tuple[Transition, dict[int, str]]:
        """Let objects and physics move for one step; return the transition, and why worlds failed in it."""
        previous = self._now
        self._move(previous)
        self.world.step(self._control(action), self.substeps)
        state, failed = _survivors(self.world.state(), previous.state)
        self._steps += 1
        self._since_success = self._since_success + 1
        self._now = self._snapshot(state)
        failures = dict.fromkeys(failed, "the physics diverged (non-finite state)")
        return Transition(previous=previous, now=self._now, action=action, duration=self.duration), failures

    def _move(self, now: Snapshot) -> None:
        """Put the phantoms that move by themselves where they will be, and send the driven bodies there."""
        for mover in self.spec.terms:
            for group, position in mover.move(now, self.duration).items():
                if group in self._slices:
                    self.world.drive(group, position, now.state.body_quaternion[:, self._slices[group]])
                else:
                    self._positions[group] = position

    def _begin(self, mask: Mask) -> Snapshot:
        """Start the next episode of the masked worlds and return the snapshot of all."""
        start, positions = self._starter.begin(mask, self._episode, self.seed)
        self.world.reset(mask, start)
        self._steps[mask] = 0
        self._since_success = np.where(mask, NEVER, self._since_success)
        for name, placed in positions.items():
            for known in (self._positions, self._origins):
                known[name] = np.where(mask[:, None, None], placed, known.get(name, placed))
        return self._snapshot(self.world.state())

    def _respawn(self, t: Transition, reached: Mask, failures: dict[int, str]) -> Transition:
        """Move the achieved goals; a world without a free place for one ends its episode with the reason."""
        self._since_success = np.where(reached, 0, self._since_success)
        now = replace(t.now, steps_since_success=self._since_success)
        group = self.spec.task.respawn()
        if group is not None:
            self._positions[group], stuck = self._starter.respawn(group, reached, now)
            self._origins[group] = self._positions[group]
            for world in np.flatnonzero(stuck).tolist():
                failures[world] = f"no free place was left for a new {group}"
            moved = {group: self._positions[group]}
            now = replace(now, bodies={**now.bodies, **moved}, origins={**now.origins, **moved})
        self._now = now
        return replace(t, now=now)

    def _snapshot(self, state: State) -> Snapshot:
        bodies = dict(self._positions)
        for name, rows in self._slices.items():
            bodies[name] = state.body_position[:, rows]
        return self._reader.read(
            state,
            bodies=bodies,
            origins=dict(self._origins),
            slices=self._slices,
            steps_since_success=self._since_success,
        )

    def _standstill(self, now: Snapshot) -> Transition:
        idle = np.zeros((self.num_worlds, self.action_size))
        return Transition(previous=now, now=now, action=idle, duration=self.duration)

    def _costs(self, t: Transition) -> Array:
        costs = np.empty((self.num_worlds, len(self.spec.constraints)))
        for column, constraint in enumerate(self.spec.constraints):
            costs[:, column] = constraint.cost(t) if self.spec.graded else constraint.indicator(t)
        return costs

    def _readings(self, t: Transition) -> dict[str, Array]:
        readings: dict[str, Array] = {}
        for sensors in self._sensors:
            readings.update(sensors.read(t))
        for term in self.spec.terms:
            readings.update(term.observe(t))
        return readings

    def _layout(self) -> dict[str, slice]:
        """Return where each reading lies in the observation: names sorted, as in GUARD."""
        readings = self._readings(self._standstill(self._now))
        layout: dict[str, slice] = {}
        first = 0
        for name in sorted(readings):
            layout[name] = slice(first, first + readings[name].shape[1])
            first = layout[name].stop
        return layout

    def _observe(self, t: Transition) -> Array:
        readings = self._readings(t)
        return np.concatenate([readings[name] for name in self.observation_layout], axis=1)


def make_environment(
    env: str | EnvSpec, *, backend: str, num_worlds: int = 1, seed: int = 0, workers: int | None = None
) -> Environment:
    """Build the environment that `env` names, or that the TOML file at the path `env` or an `EnvSpec` specifies.

    backend: name of the simulator.
    workers: threads or processes that step the worlds; None lets GUARD choose. It changes no number.
    Raises SpecError, PluginError or BackendError, each with one line that says what to do.
    """
    spec = make_spec(env) if isinstance(env, str) else env
    return Environment(spec, backend=backend, num_worlds=num_worlds, seed=seed, workers=workers)


def _actuated(name: str) -> RobotModel:
    """Return the robot `name`. Raises SpecError for one without actuators, in whose environment nobody could act."""
    robot = load_robot(name)
    if not robot.actuators:
        raise SpecError(f"robot {name!r} has no actuators, nothing can move it: add [[actuators]] to {side_file(name)}")
    return robot


def _checked(seed: int) -> int:
    """Return `seed`. Raises SpecError for a negative one, which no stream can have."""
    if seed < 0:
        raise SpecError(f"seed is {seed}: it must not be negative")
    return seed


def _survivors(state: State, previous: State) -> tuple[State, list[int]]:
    """Return the state with the rows of diverged worlds put back to `previous`, and which worlds diverged.

    So everything downstream sees finite numbers; the diverged worlds' episodes end in this step.
    """
    if np.count_nonzero(state.ok) == len(state.ok):
        return state, []
    failed = np.flatnonzero(~state.ok).tolist()
    mended = {}
    for name in State.__dataclass_fields__:
        values = getattr(state, name).copy()
        values[failed] = getattr(previous, name)[failed]
        mended[name] = values
    return State(**mended), failed
