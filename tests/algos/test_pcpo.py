"""PCPO's projections against a general solver and the published closed form, and what it does at the edges."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.optimize import Bounds, minimize

from guard_algos import pcpo, trpo
from guard_algos.pcpo import Norm, direction, projection
from guard_algos.trust_region import natural
from guard_api.runs.directory import RunDirectory
from tests.algos.bandit import Bandit, final_policy, train
from tests.algos.test_cpo_direction import RADIUS, local_model, problem

NORMS: list[Norm] = ["kl", "l2"]


def nearest(L: np.ndarray, y: np.ndarray, B: np.ndarray, c: np.ndarray) -> np.ndarray:
    """argmin |x - y|_L^2 subject to c + B x <= 0 by a general solver, on the dual: multipliers nu >= 0."""
    inverse = np.linalg.inv(L)
    S, excess = B @ inverse @ B.T, c + B @ y
    result = minimize(
        lambda nu: nu @ S @ nu / 2 - excess @ nu,
        np.ones(len(c)),
        jac=lambda nu: S @ nu - excess,
        bounds=Bounds(0, np.inf),
        method="L-BFGS-B",
        options={"ftol": 1e-16, "gtol": 1e-12, "maxiter": 5000},
    )
    return y - inverse @ B.T @ result.x


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("num_constraints", [1, 2, 3])
def test_direction_is_the_nearest_allowed_step_to_the_natural_one(norm: Norm, num_constraints: int) -> None:
    rng = np.random.default_rng(num_constraints)
    seen = {"kept": 0, "moved": 0}
    for _ in range(60):
        F, g, B, c = problem(rng, 5, num_constraints)
        model = local_model(F, g, B, c)
        x, y = direction(model, norm).delta.numpy(), natural(model).delta.numpy()
        L = F if norm == "kl" else np.eye(5)
        expected = nearest(L, y, B, c)
        np.testing.assert_allclose(x, expected, atol=1e-6 * (1 + np.abs(expected).max()))
        assert (c + B @ x <= 1e-9).all()
        assert y @ F @ y / 2 == pytest.approx(RADIUS)
        if (c <= 0).all() and norm == "kl":  # the old policy is allowed: the projection stays in the ball and improves
            assert x @ F @ x / 2 <= RADIUS * (1 + 1e-9)
            assert g @ x >= 0
        seen["kept" if np.array_equal(x, y) else "moved"] += 1
    assert min(seen.values()) >= 5, seen


@pytest.mark.parametrize("norm", NORMS)
def test_one_constraint_has_the_published_closed_form(norm: Norm) -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        F, g, B, c = problem(rng, 4, 1)
        v, b = np.linalg.solve(F, g), B[0]
        w = np.linalg.solve(F, b) if norm == "kl" else b
        length = np.sqrt(2 * RADIUS / (g @ v))
        expected = length * v - max(0, (length * b @ v + c[0]) / (b @ w)) * w
        np.testing.assert_allclose(direction(local_model(F, g, B, c), norm).delta.numpy(), expected, atol=1e-10)


@pytest.mark.parametrize("norm", NORMS)
def test_a_shortened_step_keeps_what_the_whole_step_promises(norm: Norm) -> None:
    rng = np.random.default_rng(11)
    for _ in range(50):
        F, g, B, c = problem(rng, 5, 2)
        x = direction(local_model(F, g, B, c), norm).delta.numpy()
        for scale in 0.8 ** np.arange(30):
            change = scale * B @ x
            assert (change <= np.maximum(-c, 0) + 1e-9).all()  # what CPO's acceptance asks for
            assert (change[c > 0] < 0).all()


@pytest.mark.parametrize("norm", NORMS)
def test_vanishing_gradients_give_finite_steps(norm: Norm) -> None:
    F, g, b = np.eye(3), np.array([1.0, 0, 0]), np.array([[1.0, 1, 0]])
    plain = natural(local_model(F, g, b, np.zeros(1))).delta.numpy()
    assert not direction(local_model(F, 0 * g, b, np.array([-0.1])), norm).delta.any()
    np.testing.assert_array_equal(direction(local_model(F, g, 0 * b, np.array([0.3])), norm).delta.numpy(), plain)
    np.testing.assert_array_equal(direction(local_model(F, g, np.empty((0, 3)), np.empty(0)), norm).delta, plain)
    recovering = direction(local_model(F, 0 * g, b, np.array([0.1])), norm)
    np.testing.assert_allclose(recovering.delta.numpy(), [-0.05, -0.05, 0])
    assert not direction(local_model(F, 0 * g, 0 * b, np.array([0.3])), norm).delta.any()


def test_parallel_and_contradicting_constraints() -> None:
    F, g, b = np.eye(2), np.array([1.0, 1.0]), np.array([1.0, 0.0])
    twice = direction(local_model(F, g, np.stack([b, 2 * b]), np.array([0.05, 0.1])), "kl")
    assert twice.feasible
    np.testing.assert_allclose(twice.delta.numpy(), [-0.05, np.sqrt(RADIUS)], rtol=1e-6)
    against = direction(local_model(F, g, np.stack([b, -b]), np.array([0.1, 0.1])), "kl")
    assert not against.feasible
    assert float(against.delta.norm()) < 1e-3  # neither can be helped without hurting the other
    assert projection(np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([0.1, 0.1])) is None


def test_contradicting_constraints_are_met_halfway_within_the_ball_of_the_kl_whatever_the_norm() -> None:
    """One is exceeded by far and one by little: both norms take CPO's recovering step, to the border of the ball."""
    F, g = np.diag([4.0, 100.0]), np.array([1.0, 1.0])
    model = local_model(F, g, np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 0.1]))
    for norm in NORMS:
        step = direction(model, norm)
        x = step.delta.numpy()
        assert not step.feasible
        assert x @ F @ x / 2 == pytest.approx(RADIUS)
        np.testing.assert_allclose(x, [-np.sqrt(2 * RADIUS / 4.0), 0.0], atol=1e-9)


@pytest.mark.parametrize("norm", NORMS)
def test_the_order_of_the_constraints_means_nothing(norm: Norm) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        F, g, B, c = problem(rng, 5, 3)
        order = rng.permutation(3)
        one, other = (direction(local_model(F, g, B[k], c[k]), norm).delta for k in ([0, 1, 2], order))
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12)


SMALL: dict[str, Any] = {"steps_per_epoch": 1000, "hidden": (8,), "value_iterations": 3, "threads": 1}


@pytest.mark.parametrize("norm", NORMS)
def test_far_outside_the_limit_every_step_stays_in_the_trust_region_and_lowers_the_cost(
    tmp_path: Path, norm: Norm
) -> None:
    config = pcpo.PcpoConfig(**SMALL, gamma=0.0, projection=norm, cost_limit=0.1)
    train(pcpo.algorithm, Bandit(50, 20, {"a": 1.0}), tmp_path, config, 12_000)
    rows = RunDirectory.open(tmp_path).rows()
    assert all(0 < row["kl"] <= config.target_kl and row["accepted"] for row in rows)
    assert all(row["feasible"] for row in rows)
    assert max(row["line_search_steps"] for row in rows) > 1  # the whole projected step leaves the trust region
    assert rows[-1]["cost_mean"] < 0.5 * rows[0]["cost_mean"]


@pytest.mark.parametrize("norm", NORMS)
def test_with_a_limit_that_never_binds_it_is_trpo_bit_for_bit(tmp_path: Path, norm: Norm) -> None:
    config = pcpo.PcpoConfig(**SMALL, projection=norm, cost_limit=1e6)
    train(pcpo.algorithm, Bandit(50, 20, {"a": 1.0}), tmp_path / "a", config, 6000)
    train(trpo.algorithm, Bandit(50, 20, {"a": 1.0}), tmp_path / "b", trpo.algorithm.config_type(**SMALL), 6000)
    observation = np.random.default_rng(0).standard_normal((100, 2))
    a, b = final_policy(pcpo.algorithm, tmp_path / "a"), final_policy(trpo.algorithm, tmp_path / "b")
    np.testing.assert_array_equal(a.act(observation, False), b.act(observation, False))
