"""Gymnasium's faces of the environment: single, vectorised, and the 6-tuple of Safety-Gymnasium-style libraries.

Importing this module registers every environment of the suite, so that
`gymnasium.make("guard_api.gym:guard/Goal_Point_8Hazards-v0", backend="bullet")` works in one line. Observations are
flat, (O,), or with `observations="dict"` a dictionary of the readings by name, such as "goal_compass".

An environment made without a seed draws one. `np_random_seed` is the present seed: `reset(seed=...)` with it repeats
the episodes from the first.
"""

from __future__ import annotations

import secrets
from typing import Any, Literal, TypeAlias

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from guard_api.env import Environment, Step, make_environment
from guard_api.errors import SpecError
from guard_api.spec import EnvSpec
from guard_api.suite import known_names

Observation: TypeAlias = NDArray[Any] | dict[str, NDArray[Any]]
Form: TypeAlias = Literal["flat", "dict"]
"""Whether an observation is one array or its readings by name."""


class GuardEnv(gymnasium.Env[Observation, NDArray[Any]]):
    """One world as a Gymnasium environment; `info["cost"]` is the summed cost, `info["costs"]` each by name.

    An unseeded `reset` goes on to the next episode of the current seed.
    seed: None draws one, below 2**31.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - Gymnasium declares it so

    def __init__(
        self, env: str | EnvSpec, backend: str = "mujoco", seed: int | None = None, observations: Form = "flat"
    ) -> None:
        self._form: Form = _checked(observations)
        seed = _drawn(seed)
        self.environment = make_environment(env, backend=backend, num_worlds=1, seed=seed, workers=1)
        super().reset(seed=seed)
        self.observation_space = observation_space(self.environment, self._form)
        self.action_space = action_space(self.environment)
        self.cost_names = self.environment.cost_names
        self._episode = -1
        self._ended = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode: the first of `seed` when one is given, else the next. Raises SpecError for any option."""
        _refuse(options)
        super().reset(seed=seed)
        self._episode = 0 if seed is not None else self._episode + 1
        self._ended = False
        observation = self.environment.reset(episode=self._episode, seed=seed)[0]
        return formed(self.environment, observation, self._form), {}

    def step(self, action: NDArray[np.floating]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance one step; return observation, reward, terminated, truncated, info.

        Raises ResetNeeded before the first `reset` and after the end of an episode.
        """
        if self._ended:
            raise gymnasium.error.ResetNeeded("no episode has begun, or it is over: call reset() before step()")
        step = self.environment.step(np.asarray(action, dtype=np.float64)[None])
        self._ended = bool(step.terminated[0] or step.truncated[0])
        info = {
            "cost": float(step.costs[0].sum()),
            "costs": {name: float(cost) for name, cost in zip(self.cost_names, step.costs[0], strict=True)},
            "success": bool(step.success[0]),
        }
        if step.failures:
            info["failure"] = step.failures[0]
        ended = bool(step.terminated[0]), bool(step.truncated[0])
        observation = formed(self.environment, step.final_observation[0], self._form)
        return observation, float(step.reward[0]), *ended, info

    def close(self) -> None:
        """Release the world."""
        self.environment.close()


class GuardVectorEnv(VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """N worlds as a Gymnasium vector environment; episodes that end restart in the same step.

    `info` holds "cost" (N,), "costs" (name -> (N,)) and "success" (N,); in a step that ends episodes also "final_obs"
    and "final_info" with their masks, as Gymnasium's same-step autoreset asks for.
    seed: None draws one, below 2**31.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        env: str | EnvSpec,
        num_envs: int = 1,
        backend: str = "mujoco",
        seed: int | None = None,
        workers: int | None = None,
        observations: Form = "flat",
    ) -> None:
        self._form: Form = _checked(observations)
        seed = _drawn(seed)
        self.environment = make_environment(env, backend=backend, num_worlds=num_envs, seed=seed, workers=workers)
        super().reset(seed=seed)
        self.num_envs = num_envs
        self.single_observation_space = observation_space(self.environment, self._form)
        self.single_action_space = action_space(self.environment)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._resets = -1

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start all worlds: at the first episode of `seed` when one is given, else at later episodes of the old one.

        Raises SpecError for any option, "reset_mask" among them: worlds restart on their own.
        """
        _refuse(options)
        super().reset(seed=seed)
        # Worlds restart on their own in between; a gap of a million keeps manual resets clear of those episodes.
        self._resets = 0 if seed is not None else self._resets + 1
        observation = self.environment.reset(episode=self._resets * 1_000_000, seed=seed)
        return formed(self.environment, observation, self._form), {}

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance all worlds; return observations, rewards, terminations, truncations, infos.

        Raises ResetNeeded before the first `reset`.
        """
        if self._resets < 0:
            raise gymnasium.error.ResetNeeded("no episode has begun: call reset() before step()")
        step = self.environment.step(actions)
        info = _batched_info(self.environment, step)
        ended = step.terminated | step.truncated
        if ended.any():
            final_info = dict(info)
            info["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(ended):
                info["final_obs"][i] = formed(self.environment, step.final_observation[i], self._form)
            info |= {"_final_obs": ended, "final_info": final_info, "_final_info": ended}
        observation = formed(self.environment, step.observation, self._form)
        return observation, step.reward, step.terminated, step.truncated, info

    def close_extras(self, **kwargs: Any) -> None:
        """Release the worlds."""
        self.environment.close()


class SafetyAdapter(gymnasium.Wrapper):
    """The 6-tuple face: `step` returns observation, reward, cost, terminated, truncated, info."""

    def step(self, action: Any) -> tuple[Any, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Advance one step, with the summed cost in third place."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, info["cost"], terminated, truncated, info


def observation_space(environment: Environment, form: Form = "flat") -> spaces.Space[Any]:
    """Return the space of one world's observation, unbounded: (O,), or each reading's by name."""
    if form == "flat":
        return _unbounded(environment.observation_size)
    layout = environment.observation_layout
    return spaces.Dict({name: _unbounded(part.stop - part.start) for name, part in layout.items()})


def formed(environment: Environment, observation: NDArray[Any], form: Form) -> Observation:
    """Return `observation` (..., O) as it is, or as its readings (..., k) by name."""
    if form == "flat":
        return observation
    return {name: observation[..., part] for name, part in environment.observation_layout.items()}


def action_space(environment: Environment) -> spaces.Box:
    """Return the space of one world's action: (A,) in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (environment.action_size,), np.float32)


def _unbounded(size: int) -> spaces.Box:
    return spaces.Box(-np.inf, np.inf, (size,), np.float64)


def _checked(form: Form) -> Form:
    """Return `form`. Raises SpecError for one that does not exist."""
    if form not in ("flat", "dict"):
        raise SpecError(f'observations is {form!r}: must be "flat" or "dict"')
    return form


def _drawn(seed: int | None) -> int:
    """Return `seed`, or a fresh one below 2**31 for None."""
    return secrets.randbelow(1 << 31) if seed is None else seed


def _refuse(options: dict[str, Any] | None) -> None:
    """Raise SpecError if a reset is given options: none is known, and to ignore one would surprise."""
    if options:
        raise SpecError(f"reset options {', '.join(map(repr, options))}: there are none, leave them out")


def _batched_info(environment: Environment, step: Step) -> dict[str, Any]:
    info: dict[str, Any] = {
        "cost": step.costs.sum(axis=1),
        "costs": {name: step.costs[:, i] for i, name in enumerate(environment.cost_names)},
        "success": step.success,
    }
    info |= {f"_{key}": np.ones(environment.num_worlds, dtype=bool) for key in info}
    if step.failures:
        info["failure"] = np.array([step.failures.get(i, "") for i in range(environment.num_worlds)], dtype=object)
        info["_failure"] = step.terminated
    return info


def register() -> None:
    """Register every environment of the suite as `guard/<name>-v0`; repeated calls change nothing."""
    for name in known_names():
        env_id = f"guard/{name}-v0"
        if env_id not in gymnasium.registry:
            gymnasium.register(
                id=env_id,
                entry_point="guard_api.gym:GuardEnv",
                vector_entry_point="guard_api.gym:GuardVectorEnv",
                kwargs={"env": name},
                disable_env_checker=True,
            )


register()
