"""TRPO-SL: its correction against brute force, its model against automatic differentiation, and batches of one kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.optimize import linprog, minimize

from guard_algos import trpo_sl
from guard_algos.box import project
from guard_algos.networks import ROWS, Mlp
from guard_algos.trpo_sl import CostModel, TrpoSlConfig, balanced, costs_before, safest
from guard_algos.workers import workers
from guard_api.errors import RunError
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Script, final_policy, train
from tests.algos.corridor import PACE, Corridor


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def random_problems(rng: np.random.Generator, count: int, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Actions in the box, some of them at its bounds; normals, some components 0; excesses from small to impossible."""
    action = np.clip(1.5 * rng.uniform(-1, 1, (count, size)), -1, 1)
    normal = rng.standard_normal((count, size)) * (rng.random((count, size)) < 0.8)
    return action, normal, rng.uniform(0, 1.5, count) * np.abs(normal).sum(axis=1)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_projection_is_the_nearest_point_of_the_box_that_a_general_solver_finds(size: int) -> None:
    action, normal, excess = random_problems(np.random.default_rng(size), 40, size)
    found = project(*(torch.from_numpy(x) for x in (action, normal, excess))).numpy()
    single = project(*(torch.from_numpy(x).float() for x in (action, normal, excess))).numpy()
    np.testing.assert_allclose(single, found, atol=2e-5)
    assert np.abs(found).max() <= 1
    kinds = set()
    for a, n, e, x in zip(action, normal, excess, found, strict=True):
        goal = n @ a - e
        least = -np.abs(n).sum()
        if goal <= least:  # no point of the box: the least value, without moving what does not matter
            kinds.add("impossible")
            np.testing.assert_allclose(x, np.where(n == 0, a, -np.sign(n)), atol=1e-12)
            assert n @ x == pytest.approx(linprog(n, bounds=(-1, 1)).fun)
            continue
        kinds.add("bound" if (np.abs(x[n != 0]) == 1).any() else "inside")
        assert n @ x <= goal + 1e-12 * (1 + abs(goal))
        face = {"type": "ineq", "fun": lambda y, n=n, goal=goal: goal - n @ y, "jac": lambda y, n=n: -n}
        best = minimize(
            lambda y, a=a: np.square(y - a).sum() / 2,
            np.zeros(size),
            jac=lambda y, a=a: y - a,
            bounds=[(-1, 1)] * size,
            constraints=[face],
            options={"ftol": 1e-15, "maxiter": 300},
        )
        np.testing.assert_allclose(x, best.x, atol=1e-6)
    assert kinds >= {"impossible", "inside"} | ({"bound"} if size > 1 else set())


def test_projection_beats_every_point_of_a_grid_at_the_bounds() -> None:
    rng = np.random.default_rng(0)
    action, normal, excess = random_problems(rng, 200, 2)
    excess = np.minimum(excess, 0.9 * (np.abs(normal) + normal * action).sum(axis=1))  # possible
    found = project(*(torch.from_numpy(x) for x in (action, normal, excess))).numpy()
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 81)] * 2), axis=-1).reshape(-1, 2)
    for a, n, e, x in zip(action, normal, excess, found, strict=True):
        allowed = grid[grid @ n <= n @ a - e]
        assert np.square(x - a).sum() <= np.square(allowed - a).sum(axis=1).min() + 1e-12


def test_inside_the_box_the_correction_is_the_closed_form_of_the_paper() -> None:
    action, slope = torch.tensor([[0.3, 0.2]]), torch.tensor([[[0.5, -0.25]]])
    cost, limit = torch.tensor([[0.1]]), 0.15
    excess = cost + (slope[:, 0] * action).sum(-1, keepdim=True) - limit
    multiplier = excess / slope.square().sum()
    torch.testing.assert_close(safest(action, slope, excess), action - multiplier * slope[:, 0])


def test_of_several_constraints_the_one_with_the_largest_multiplier_is_active() -> None:
    action = torch.zeros(3, 2)
    slope = torch.tensor([[[1.0, 0.0], [0.0, 0.1]], [[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 0.0]]])
    # World 0: multipliers 0.2 and 5, though the first exceeds more. World 1: nothing changes the second. World 2: nor.
    excess = torch.tensor([[0.2, 0.05], [-0.1, 0.3], [0.1, 0.2]])
    expected = torch.tensor([[0.0, -0.5], [0.0, 0.0], [0.0, 0.0]])
    torch.testing.assert_close(safest(action, slope, excess), expected)


def test_the_cost_model_is_fitted_as_automatic_differentiation_fits_it_and_reports_its_losses() -> None:
    network = Mlp((3, 8, 2))
    model = CostModel(network, generator(), 1e-2)
    theta = model.tensors()["parameters"].clone().requires_grad_()
    rows = ROWS + 5
    x, action = torch.randn(rows, 3, generator=generator()), torch.rand(rows, 2, generator=generator())
    change, weight = x[:, 0] * action[:, 1] + x[:, 2], torch.rand(rows, generator=generator())
    weight /= weight.sum()
    optimiser = torch.optim.Adam([theta], lr=1e-2)
    losses = []
    for _ in range(21):
        loss = (weight * ((network.forward(theta, x) * action).sum(-1) - change).square()).sum()
        losses.append(float(loss.detach()))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    with workers(2) as pool:
        before, after = model.fit(x, action, change, weight, 20, len(x), pool)
    assert before == pytest.approx(losses[0], rel=1e-5)
    assert after == pytest.approx(losses[20], rel=1e-3)
    assert after < before


def test_each_kind_of_step_weighs_one_half_and_alike_where_one_is_missing() -> None:
    mixed = torch.tensor([True, False, False, False])
    torch.testing.assert_close(balanced(mixed), torch.tensor([1 / 2, 1 / 6, 1 / 6, 1 / 6]))
    for kind in (False, True):
        torch.testing.assert_close(balanced(torch.full((4,), kind)), torch.full((4,), 0.25))


@pytest.mark.parametrize("cost", [0.0, 0.7])
def test_batches_without_any_and_with_nothing_but_costs_train_to_finite_numbers(tmp_path: Path, cost: float) -> None:
    T, N = 10, 4
    ended = np.eye(T)[:, [-1] * N]
    reward = np.random.default_rng(0).standard_normal((T, N))
    env = Script(reward, np.full((T, N, 1), cost), np.zeros((T, N)), ended, np.zeros((T, N)), ("a",))
    options = {"steps_per_epoch": T * N, "hidden": (4,), "value_iterations": 20, "warmup_ratio": 0.25}
    train(trpo_sl.algorithm, env, tmp_path, TrpoSlConfig(**options), 4 * T * N)
    rows = RunDirectory.open(tmp_path).rows()
    assert np.isfinite([list(row.values()) for row in rows]).all()
    assert [row["shield_active"] for row in rows] == [0.0, 1.0, 1.0, 1.0]
    assert rows[-1]["shield_cost_loss_after"] < rows[0]["shield_cost_loss_before"]
    if cost:  # what was measured is above the threshold, and only an action can make up for it
        assert rows[-1]["corrected_rate"] > 0.5


def test_the_model_learns_what_an_action_costs_beyond_the_line_and_nothing_far_from_it() -> None:
    rng = np.random.default_rng(0)
    place, action = rng.uniform((-1, -1), (2, 1), (3000, 2)), rng.uniform(-1, 1, (3000, 2))
    before, after = (np.maximum(x - 0.5, 0.0) for x in (place[:, 0], place[:, 0] + PACE * action[:, 0]))
    x, a, change = (torch.from_numpy(column).float() for column in (place, action, after - before))
    model = CostModel(Mlp((2, 16, 2)), generator(), 0.01)
    with workers(1) as pool:
        model.fit(x, a, change, balanced(torch.from_numpy(after > 0)), 400, len(x), pool)
    slope = model.slope(torch.tensor([[1.2, 0.5], [1.7, -0.6], [-0.5, 0.3], [0.0, -0.8]]))
    torch.testing.assert_close(slope, torch.tensor([[PACE, 0.0]] * 2 + [[0.0, 0.0]] * 2), atol=0.05, rtol=0)


def test_the_layer_was_given_the_costs_of_the_step_before_and_none_at_an_episode_s_start(tmp_path: Path) -> None:
    from guard_algos.rollout import collect

    rng = np.random.default_rng(0)
    T, N = 6, 2
    terminated, truncated = np.zeros((T, N), bool), np.zeros((T, N), bool)
    terminated[1, 0] = truncated[3, 1] = truncated[5] = True
    env = Script(rng.random((T, N)), rng.random((T, N, 3)), terminated, truncated, np.zeros((T, N)), ("a", "b", "c"))
    given = []

    def correct(observation: torch.Tensor, costs: torch.Tensor | None, action: torch.Tensor) -> torch.Tensor:
        assert costs is not None
        given.append(costs.numpy().copy())
        return action + 1

    act = lambda observation, noise: noise  # noqa: E731
    rollout = collect(env, act, episode=0, num_steps=T, generator=generator(), correct=correct)  # type: ignore[arg-type]
    expected = np.zeros((T, N, 3))
    expected[1:] = env._costs[:-1]
    expected[2, 0] = expected[4, 1] = 0.0
    np.testing.assert_array_equal(given, expected)
    np.testing.assert_array_equal(costs_before(rollout), expected)
    np.testing.assert_array_equal(rollout.executed, rollout.action + 1)
    np.testing.assert_array_equal(np.stack(env.actions).astype(np.float32), rollout.executed.numpy())


def test_a_policy_with_a_layer_says_that_it_needs_the_costs(tmp_path: Path) -> None:
    options = {"steps_per_epoch": 1000, "hidden": (4,), "value_iterations": 1}
    train(trpo_sl.algorithm, Corridor(), tmp_path, TrpoSlConfig(**options), 1000)
    policy = final_policy(trpo_sl.algorithm, tmp_path)
    for costs in (None, np.zeros((3, 1)), np.zeros((2, 2))):
        with pytest.raises(RunError, match=r"safety layer needs those of the step before, \(3, 2\)"):
            policy.act(np.zeros((3, 2)), True, costs)
    assert policy.act(np.zeros((3, 2)), True, np.zeros((3, 2))).shape == (3, 2)
