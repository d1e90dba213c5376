"""CPO's step against numerical optima of the linear-quadratic problem that it claims to solve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize

from guard_algos.cpo import accept, direction, optimum, recovery
from guard_algos.trust_region import LocalModel, Step, Trial

RADIUS = 0.02


def problem(rng: np.random.Generator, size: int, num_constraints: int) -> tuple[np.ndarray, ...]:
    """Random F, g, B (K, P) and margins c (K,): some slack, some exceeded, some beyond the trust region."""
    root = rng.standard_normal((size, size))
    F = root @ root.T + 0.1 * np.eye(size)
    g, B = rng.standard_normal(size), rng.standard_normal((num_constraints, size))
    reach = np.sqrt(2 * RADIUS * np.einsum("kp,pk->k", B, np.linalg.solve(F, B.T)))
    return F, g, B, reach * rng.uniform(-1.6, 1.6, num_constraints)


def local_model(F: np.ndarray, g: np.ndarray, B: np.ndarray, c: np.ndarray) -> LocalModel:
    inverse = torch.from_numpy(np.linalg.inv(F))
    return LocalModel(
        gradient=torch.from_numpy(g),
        cost_gradients=tuple(torch.from_numpy(b) for b in B),
        margins=c,
        solve=lambda x: inverse @ x,
        radius=RADIUS,
    )


def least_violation(F: np.ndarray, B: np.ndarray, c: np.ndarray) -> float:
    """|max(0, c + B x)|^2 at its least over the ball, found numerically."""
    ball = {"type": "ineq", "fun": lambda x: RADIUS - x @ F @ x / 2, "jac": lambda x: -F @ x}
    result = minimize(
        lambda x: np.square(np.maximum(c + B @ x, 0)).sum(),
        np.zeros(len(F)),
        jac=lambda x: 2 * B.T @ np.maximum(c + B @ x, 0),
        constraints=[ball],
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return float(result.fun)


def dual(F: np.ndarray, g: np.ndarray, B: np.ndarray, c: np.ndarray) -> float:
    """The least value of the dual over lambda > 0, nu >= 0, by a general solver: the optimum of a feasible problem."""
    inverse = np.linalg.inv(F)
    q, r, S = g @ inverse @ g, B @ inverse @ g, B @ inverse @ B.T

    def value(z: np.ndarray) -> tuple[float, np.ndarray]:
        lam, nu = z[0], z[1:]
        quadratic = q - 2 * r @ nu + nu @ S @ nu
        slope = np.r_[RADIUS - quadratic / (2 * lam**2), (S @ nu - r) / lam - c]
        return float(quadratic / (2 * lam) + lam * RADIUS - nu @ c), slope

    starts = [np.r_[np.sqrt(q / (2 * RADIUS)), np.full(len(c), nu)] for nu in (0.0, 1.0)]
    bounds = [(1e-9, None)] + [(0, None)] * len(c)
    options = {"ftol": 1e-15, "gtol": 1e-11, "maxiter": 2000}
    return min(
        float(minimize(value, z, jac=True, bounds=bounds, method="L-BFGS-B", options=options).fun) for z in starts
    )


@pytest.mark.parametrize("num_constraints", [1, 2, 3])
def test_direction_is_optimal_where_feasible_and_least_violating_where_not(num_constraints: int) -> None:
    rng = np.random.default_rng(num_constraints)
    seen = {"inactive": 0, "active": 0, "recovery": 0}
    for _ in range(70):
        F, g, B, c = problem(rng, 5, num_constraints)
        step = direction(local_model(F, g, B, c))
        x = step.delta.numpy()
        assert x @ F @ x / 2 <= RADIUS * (1 + 1e-6)
        if step.feasible:
            assert (c + B @ x <= 1e-7).all()
            assert g @ x == pytest.approx(dual(F, g, B, c), rel=1e-4, abs=1e-7)
            seen["active" if np.isclose(c + B @ x, 0, atol=1e-7).any() else "inactive"] += 1
        else:
            violation = np.square(np.maximum(c + B @ x, 0)).sum()
            best = least_violation(F, B, c)
            assert best > 1e-8
            assert violation == pytest.approx(best, rel=1e-3)
            assert x @ F @ x / 2 == pytest.approx(RADIUS)
            seen["recovery"] += 1
    assert min(seen.values()) >= 5, seen


def test_one_constraint_has_the_published_closed_forms() -> None:
    rng = np.random.default_rng(7)
    cases = set()
    for _ in range(200):
        F, g, B, c = problem(rng, 4, 1)
        v, w = np.linalg.solve(F, g), np.linalg.solve(F, B[0])
        q, r, s = g @ v, B[0] @ v, B[0] @ w
        room = 2 * RADIUS - c[0] ** 2 / s
        if room < 0 and c[0] >= 0:
            expected, case = -np.sqrt(2 * RADIUS / s) * w, "recovery"
        else:
            nu = 0.0 if room < 0 else max(0.0, (r + c[0] * np.sqrt((q - r * r / s) / room)) / s)
            lam = np.sqrt((q - 2 * nu * r + nu * nu * s) / (2 * RADIUS))
            expected, case = (v - nu * w) / lam, "active" if nu > 0 else "inactive"
        cases.add(case)
        np.testing.assert_allclose(direction(local_model(F, g, B, c)).delta.numpy(), expected, rtol=1e-5, atol=1e-8)
    assert cases == {"recovery", "active", "inactive"}


def test_margin_of_exactly_zero_and_vanishing_gradients_give_finite_steps() -> None:
    F, g, b = np.eye(3), np.array([1.0, 0, 0]), np.array([[1.0, 1, 0]])
    step = direction(local_model(F, g, b, np.zeros(1)))  # along g, projected off b
    np.testing.assert_allclose(step.delta.numpy(), 0.2 * np.array([0.5, -0.5, 0]) / np.sqrt(0.5), rtol=1e-12)
    same = direction(local_model(F, g, g[None], np.zeros(1)))  # reward and cost are the same: stay
    np.testing.assert_allclose(same.delta.numpy(), 0.0, atol=1e-9)
    no_reward = direction(local_model(F, 0 * g, b, np.array([-0.1])))
    assert no_reward.feasible and not no_reward.delta.any()
    no_cost_gradient = direction(local_model(F, g, 0 * b, np.array([0.3])))  # the step cannot help: plain TRPO
    np.testing.assert_allclose(no_cost_gradient.delta.numpy(), 0.2 * g, rtol=1e-12)
    no_constraint = direction(local_model(F, g, np.empty((0, 3)), np.empty(0)))
    np.testing.assert_allclose(no_constraint.delta.numpy(), 0.2 * g, rtol=1e-12)


def test_costs_may_be_in_units_of_any_size() -> None:
    F, g, b, c = np.eye(3), np.ones(3), np.array([[1.0, 0.2, 0], [0, 1.0, 0.3]]), np.array([0.01, 0.02])
    units = np.array([1e6, 1e-9])
    same = direction(local_model(F, g, units[:, None] * b, units * c))
    expected = direction(local_model(F, g, b, c))
    assert same.feasible and expected.feasible
    np.testing.assert_allclose(same.delta.numpy(), expected.delta.numpy(), rtol=1e-9)


@pytest.mark.parametrize("seed", range(50))
def test_a_solver_that_stops_early_does_no_harm_where_costs_are_nearly_parallel(seed: int) -> None:
    """Conjugate gradients leave errors of a per cent, which make the costs' products indefinite."""
    rng = np.random.default_rng(seed)
    F, g, b, _ = problem(rng, 6, 1)
    B = np.concatenate([b, 0.25 * b + 1e-4 * rng.standard_normal((1, 6))])
    reach = np.sqrt(2 * RADIUS * b[0] @ np.linalg.solve(F, b[0]))
    model = local_model(F, g, B, reach * rng.uniform(-1.6, 1.6, 2) * [1.0, 0.25])
    solved = iter(
        [
            model.solve(x) * (1 + 0.01 * torch.from_numpy(rng.standard_normal(6)))
            for x in (model.gradient, *model.cost_gradients)
        ]
    )
    step = direction(replace(model, solve=lambda x: next(solved))).delta.numpy()
    assert np.isfinite(step).all()
    assert 0 < step @ F @ step / 2 < 1.5 * RADIUS


def test_parallel_and_contradicting_constraints() -> None:
    F, g, b = np.eye(2), np.array([1.0, 1.0]), np.array([1.0, 0.0])
    twice = direction(local_model(F, g, np.stack([b, 2 * b]), np.array([0.05, 0.1])))
    assert twice.feasible and twice.delta[0] == pytest.approx(-0.05)
    against = direction(local_model(F, g, np.stack([b, -b]), np.array([0.1, 0.1])))
    assert not against.feasible
    assert abs(float(against.delta[0])) < 1e-3  # neither can be helped without hurting the other
    q, r, S = 2.0, np.array([1.0]), np.array([[1.0]])
    assert optimum(q, r, S, np.array([5.0]), RADIUS) is None
    np.testing.assert_allclose(recovery(S, np.array([5.0]), RADIUS), [0.2])


@pytest.mark.parametrize(
    ("margin", "cost_change", "improvement", "feasible", "kl", "expected"),
    [
        (-0.1, 0.09, 0.1, True, 0.01, True),  # slack may be used
        (-0.1, 0.11, 0.1, True, 0.01, False),  # but not more
        (-0.1, 0.0, -0.1, True, 0.01, False),  # and not for a worse policy
        (0.0, 0.0, 0.0, True, 0.01, True),
        (0.1, -0.01, -0.1, True, 0.01, True),  # above the limit, less cost is worth less return
        (0.1, 0.01, 0.1, True, 0.01, False),
        (0.1, -0.01, -0.1, False, 0.01, True),
        (0.1, 0.01, 0.1, False, 0.01, False),
        (0.1, -0.01, 0.1, False, 0.03, False),  # outside the ball
        (0.1, float("nan"), 0.1, False, 0.01, False),
        (0.1, -0.01, 0.1, True, float("nan"), False),
    ],
)
def test_accept(
    margin: float, cost_change: float, improvement: float, feasible: bool, kl: float, expected: bool
) -> None:
    local = local_model(np.eye(1), np.ones(1), np.ones((1, 1)), np.array([margin]))
    trial = Trial(kl=kl, improvement=improvement, cost_changes=np.array([cost_change]))
    assert accept(trial, local, Step(torch.zeros(1), feasible)) == expected


def test_recovery_accepts_a_cost_that_rises_for_a_larger_one_to_fall() -> None:
    local = local_model(np.eye(2), np.ones(2), np.eye(2), np.array([1.0, 0.0]))
    better = Trial(kl=0.01, improvement=0.0, cost_changes=np.array([-0.5, 0.1]))
    worse = Trial(kl=0.01, improvement=0.0, cost_changes=np.array([-0.1, 0.9]))
    assert accept(better, local, Step(torch.zeros(2), feasible=False))
    assert not accept(worse, local, Step(torch.zeros(2), feasible=False))
