"""The compiled loops say what the plain forms say, on whole episodes of robots that use all of them."""

from __future__ import annotations

import numpy as np
import pytest

from guard_api import kernels
from guard_api.env import make_environment

pytest.importorskip("numba")

# A planar base with massless links, legs with touch, flight among balls, an arm's many sensing frames.
ENVIRONMENTS = ["Goal_Point_8Hazards", "Push_Ant_8Vases", "Goal_Drone_8Hazards", "Goal_Arm3_8Ghosts"]


def _run(name: str, backend: str) -> list[np.ndarray]:
    environment = make_environment(name, backend=backend, num_worlds=3, seed=1, workers=1)
    rng, seen = np.random.default_rng(0), [environment.reset()]
    for _ in range(8):
        step = environment.step(rng.uniform(-1, 1, (3, environment.action_size)))
        seen += [step.observation, step.reward, step.costs]
    environment.close()
    return seen


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_an_episode_is_the_same_without_numba(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mujoco_kernels = pytest.importorskip("guard_mujoco.kernels")
    compiled = _run(name, "mujoco")
    switched_off = 0
    for module in (kernels, mujoco_kernels):
        for key, value in list(vars(module).items()):
            if hasattr(value, "cache_clear"):
                monkeypatch.setattr(module, key, lambda: None)
                switched_off += 1
    assert switched_off >= 6
    for fast, plain in zip(compiled, _run(name, "mujoco"), strict=True):
        np.testing.assert_allclose(fast, plain, rtol=0, atol=1e-11)


def test_loops_are_compiled_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.core import caching

    def full(*args: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    doubled = kernels.kernel("float64[::1], float64[::1]")(_double)()
    assert doubled is not None
    result = np.empty(2)
    doubled(np.array([1.0, 2.0]), result)
    np.testing.assert_array_equal(result, [2.0, 4.0])


def _double(values: np.ndarray, result: np.ndarray) -> None:
    for i in range(len(values)):
        result[i] = 2.0 * values[i]
