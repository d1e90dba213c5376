"""The pieces of a trust-region update against dense, slow or library versions of themselves."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import Independent, Normal, kl_divergence

from guard_algos import gae
from guard_algos.adam import Adam
from guard_algos.critics import Critic
from guard_algos.fisher import LocalPolicy
from guard_algos.gaussian import GaussianPolicy
from guard_algos.networks import ROWS, Mlp
from guard_algos.trust_region import LocalModel, Step, Trial, conjugate_gradient, improves, natural, surrogate
from guard_algos.workers import workers


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def small_policy(rows: int = 40) -> tuple[GaussianPolicy, Tensor, Tensor]:
    policy = GaussianPolicy(Mlp((3, 5, 4, 2)))
    theta = policy.init(generator(), -0.5)
    theta[-2:] += torch.tensor([0.3, -0.4])
    return policy, theta, torch.randn(rows, 3, generator=generator())


def distribution(policy: GaussianPolicy, theta: Tensor, observation: Tensor) -> Independent:
    return Independent(Normal(policy.mean(theta, observation), policy.split(theta)[1].exp()), 1)


def test_products_with_the_network_jacobian_equal_automatic_differentiation() -> None:
    network = Mlp((3, 5, 4, 2))
    theta, x = network.init(generator()).double(), torch.randn(7, 3, generator=generator(), dtype=torch.float64)
    direction = torch.randn(len(theta), generator=generator(), dtype=torch.float64)
    cotangent = torch.randn(7, 2, generator=generator(), dtype=torch.float64)
    jacobian = torch.autograd.functional.jacobian(lambda p: network.forward(p, x), theta)
    assert isinstance(jacobian, Tensor)
    activations = network.activations(theta, x)
    out = torch.ones_like(theta)
    network.pull(theta, activations, cotangent, out=out)
    (w1, b1), (w2, b2), (w3, b3) = network.layers(theta)
    torch.testing.assert_close(activations[-1], torch.tanh(torch.tanh(x @ w1.T + b1) @ w2.T + b2) @ w3.T + b3)
    torch.testing.assert_close(network.push(theta, activations, direction), jacobian @ direction)
    torch.testing.assert_close(out - 1, torch.einsum("mop,mo->p", jacobian, cotangent))


def test_initial_parameters_are_as_wide_as_pytorch_linear_layers() -> None:
    network = Mlp((100, 64, 1))
    (w1, b1), (w2, b2) = network.layers(network.init(generator()))
    for tensor, bound in ((w1, 0.1), (b1, 0.1), (w2, 0.125), (b2, 0.125)):
        assert tensor.abs().max() <= bound
    assert w1.std() == pytest.approx(0.1 / 3**0.5, rel=0.05)


def test_kl_and_log_prob_and_entropy_equal_torch_distributions() -> None:
    policy, old, x = small_policy()
    new = old + 0.1 * torch.randn(len(old), generator=generator())
    old_distribution, new_distribution = distribution(policy, old, x), distribution(policy, new, x)
    expected = kl_divergence(old_distribution, new_distribution).mean()
    kl = policy.kl(old[-2:], policy.mean(old, x), new[-2:], policy.mean(new, x))
    assert float(kl) == pytest.approx(float(expected), rel=1e-5)
    action = torch.randn(len(x), 2, generator=generator())
    log_prob = policy.log_prob(new[-2:], policy.mean(new, x), action)
    torch.testing.assert_close(log_prob, new_distribution.log_prob(action))
    assert policy.entropy(new) == pytest.approx(float(new_distribution.entropy()[0]), rel=1e-6)


def test_fisher_product_equals_the_dense_hessian_of_the_kl() -> None:
    policy, theta, x = small_policy(rows=ROWS + 17)
    theta, x = theta.double(), x.double()
    mean = policy.mean(theta, x)
    kl = lambda p: policy.kl(theta[-2:], mean, p[-2:], policy.mean(p, x))  # noqa: E731
    dense = torch.autograd.functional.hessian(kl, theta)
    assert isinstance(dense, Tensor)
    with workers(2) as pool:
        local = LocalPolicy(policy, theta, x, pool)
        columns = torch.stack([local.fisher(unit) for unit in torch.eye(len(theta), dtype=torch.float64)])
    torch.testing.assert_close(columns, dense, rtol=1e-9, atol=1e-12)


def test_policy_gradient_equals_automatic_differentiation() -> None:
    policy, theta, x = small_policy(rows=ROWS + 17)
    action, advantage = torch.randn(len(x), 2, generator=generator()), torch.randn(len(x), generator=generator())
    with workers(2) as pool:
        local = LocalPolicy(policy, theta, x, pool)
        mean, log_std = policy.means(theta, x, pool).requires_grad_(), theta[-2:].clone().requires_grad_()
        value = surrogate(advantage, torch.zeros(()))(policy.log_prob(log_std, mean, action))
        gradient = local.gradient(*torch.autograd.grad(value, (mean, log_std)))
    leaf = theta.clone().requires_grad_()
    expected = (torch.exp(distribution(policy, leaf, x).log_prob(action)) * advantage).mean()
    torch.testing.assert_close(gradient, torch.autograd.grad(expected, leaf)[0], rtol=1e-4, atol=1e-7)


def test_conjugate_gradient_solves_and_reports_the_true_residual() -> None:
    root = torch.randn(12, 12, generator=generator(), dtype=torch.float64)
    A, b = root @ root.T + torch.eye(12), torch.randn(12, generator=generator(), dtype=torch.float64)
    exact = conjugate_gradient(lambda x: A @ x, b, iterations=50, tolerance=1e-12)
    torch.testing.assert_close(exact.x, torch.linalg.solve(A, b))
    early = conjugate_gradient(lambda x: A @ x, b, iterations=4, tolerance=0.0)
    assert early.iterations == 4
    assert early.residual == pytest.approx(float((A @ early.x - b).norm() / b.norm()), rel=1e-6)
    zero = conjugate_gradient(lambda x: A @ x, torch.zeros(12), iterations=4, tolerance=0.0)
    assert not zero.x.any() and zero.iterations == 0


def model(g: Tensor, F: Tensor, radius: float) -> LocalModel:
    solve = lambda x: torch.linalg.solve(F, x)  # noqa: E731
    return LocalModel(gradient=g, cost_gradients=(), margins=np.empty(0), solve=solve, radius=radius)


def test_natural_step_maximises_the_gradient_on_the_border_of_the_ball() -> None:
    root = torch.randn(6, 6, generator=generator(), dtype=torch.float64)
    F, g = root @ root.T + torch.eye(6), torch.randn(6, generator=generator(), dtype=torch.float64)
    x = natural(model(g, F, 0.02)).delta
    assert float(x @ F @ x) / 2 == pytest.approx(0.02)
    others = torch.randn(500, 6, generator=generator(), dtype=torch.float64)
    others *= (0.04 / torch.einsum("ni,ij,nj->n", others, F, others)).sqrt()[:, None]
    assert float(g @ x) >= float((others @ g).max())
    assert not natural(model(torch.zeros(6, dtype=torch.float64), F, 0.02)).delta.any()


@pytest.mark.parametrize(
    ("kl", "improvement", "expected"),
    [(0.02, 0.1, True), (0.019, 0.0, True), (0.0201, 0.1, False), (0.01, -1e-6, False), (float("nan"), 1.0, False)],
)
def test_improves_accepts_inside_the_ball_and_not_worse(kl: float, improvement: float, expected: bool) -> None:
    local = model(torch.zeros(1), torch.eye(1), 0.02)
    trial = Trial(kl=kl, improvement=improvement, cost_changes=np.empty(0))
    assert improves(trial, local, Step(torch.zeros(1))) == expected


def reference_advantage(x, value, next_value, ended, discount, weight):
    """The definition, one sum per step."""
    T, N, K = x.shape
    result = np.zeros_like(x)
    for t, n, k in np.ndindex(T, N, K):
        for s in range(t, T):
            delta = x[s, n, k] + discount * next_value[s, n, k] - value[s, n, k]
            result[t, n, k] += (discount * weight) ** (s - t) * delta
            if ended[s, n]:
                break
    return result


def test_advantages_equal_their_definition_and_weight_one_gives_the_return_to_go() -> None:
    rng = np.random.default_rng(0)
    x, value, next_value = (rng.standard_normal((12, 3, 2)) for _ in range(3))
    ended = rng.random((12, 3)) < 0.2
    expected = reference_advantage(x, value, next_value, ended, 0.9, 0.8)
    np.testing.assert_allclose(gae.advantages(x, value, next_value, ended, 0.9, 0.8), expected, atol=1e-12)
    # With consistent values, A + V at weight 1 is the discounted sum up to the end and the bootstrap beyond it.
    next_value[:-1][~ended[:-1]] = value[1:][~ended[:-1]]
    target = value + gae.advantages(x, value, next_value, ended, 0.9, 1.0)
    for t in reversed(range(12)):
        goes_on = ~ended[t] & (t < 11)
        tail = np.where(goes_on[:, None], target[min(t + 1, 11)], next_value[t])
        np.testing.assert_allclose(target[t], x[t] + 0.9 * tail, atol=1e-12)


@pytest.mark.parametrize("momentum", [0.9, 0.0])
def test_adam_equals_torch(momentum: float) -> None:
    ours = torch.randn(9, generator=generator())
    theirs = ours.clone().requires_grad_()
    adam, reference = Adam(ours, 0.01, momentum), torch.optim.Adam([theirs], lr=0.01, betas=(momentum, 0.999))
    for _ in range(20):
        gradient = torch.randn(9, generator=generator()) * ours
        adam.step(gradient)
        theirs.grad = gradient.clone()
        reference.step()
    torch.testing.assert_close(ours, theirs.detach(), rtol=1e-5, atol=1e-7)


def test_critic_fits_as_automatic_differentiation_does_and_reports_its_losses() -> None:
    network = Mlp((3, 8, 1))
    critic = Critic(network, generator(), 1e-3)
    theta = critic.tensors()["parameters"].clone().requires_grad_()
    x = torch.randn(ROWS + 5, 3, generator=generator())
    target = x.square().sum(-1)
    optimiser = torch.optim.Adam([theta], lr=1e-3)
    losses = []
    for _ in range(31):
        loss = (network.forward(theta, x)[:, 0] - target).square().mean()
        losses.append(float(loss.detach()))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    with workers(2) as pool:
        before, after = critic.fit(x, target, 30, len(x), pool)
        values = critic.predict(x, pool)
    assert before == pytest.approx(losses[0], rel=1e-5)
    assert after == pytest.approx(losses[30], rel=1e-4)
    assert after < before
    assert values.sub(target).square().mean() == pytest.approx(after, rel=1e-5)
