"""TRPO-SL: TRPO behind a safety layer, which moves every action as little as a linear model of the next cost allows.

    argmin over a in [-1, 1]^A of |a - a_pi|^2 / 2   subject to   c_k(s) + g_k(s) . a <= C_k

c_k(s) is the cost measured in the step before, g_k is a network, and C_k is the threshold of the next step's cost.
Source: Dalal et al. 2018, "Safe Exploration in Continuous Action Spaces", sections 4 and 5 and proposition 1.

Decisions:
- The paper fits g beforehand, to episodes of random actions, and allows any trajectories of "arbitrary actions". Here
  every epoch's steps are fitted after it, as GUARD does: in these tasks random actions hardly ever meet what costs, and
  the model must hold where the policy goes. Until the warm-up is over the layer only learns.
- Costs are mostly zero. Steps with and without cost weigh one half each, all steps alike where one kind is missing, so
  that no batch divides by zero; GUARD draws a random subset of the zeros instead and fails on such batches.
- The bounds belong to the problem: its solution is exact (`box.project`), the paper's closed form is clipped afterwards
  and then exceeds the threshold although an action exists that meets it. Away from the bounds both are the same.
- Of several constraints, the one with the largest multiplier is taken to be active, as the paper does.
- The model has no term for how the cost changes whatever is done, though that is most of the change where actions are
  forces: within one step Point's full thrust moves it by 0.6 mm, its velocity by up to 30 mm. So g says which actions
  go along with a rising cost, 40 times what they do to it, and the layer undoes those. A model with that term fits
  better and is a worse layer: what it leaves to g is its error, on whose sign the layer acts (results/README.md).
- What is executed cannot take part in the gradient, and the proposed action does: `shield` says why.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from guard_algos import box, shield, trust_region
from guard_algos.adam import Adam
from guard_algos.batch import Batch
from guard_algos.finite import finite
from guard_algos.gaussian import GaussianPolicy
from guard_algos.minibatches import minibatches
from guard_algos.networks import Mlp, accumulate, pieces
from guard_algos.on_policy import Method, OnPolicyAlgorithm, Problem
from guard_algos.rollout import Correct, Rollout
from guard_api.errors import RunError


@dataclass(frozen=True, kw_only=True)
class TrpoSlConfig(shield.ShieldConfig):
    """Options of TRPO-SL; the model of the costs is fitted with the options of the critics."""


class CostModel:
    """c(s') = c(s) + g(s) . a: how the cost of the next step changes with the action.

    network: from observations to the A components of g.
    """

    def __init__(self, network: Mlp, generator: torch.Generator, learning_rate: float) -> None:
        self._network = network
        self._parameters = network.init(generator)
        self._adam = Adam(self._parameters, learning_rate)

    def tensors(self) -> dict[str, Tensor]:
        """Return the live parameters and optimiser state."""
        return {"parameters": self._parameters} | {f"adam.{k}": v for k, v in self._adam.tensors().items()}

    def slope(self, observation: Tensor) -> Tensor:
        """Return g (M, A) at observations (M, O)."""
        return self._network.forward(self._parameters, observation)

    def fit(
        self,
        observation: Tensor,
        action: Tensor,
        change: Tensor,
        weight: Tensor,
        iterations: int,
        batch_size: int,
        pool: Executor,
    ) -> tuple[float, float]:
        """Take Adam steps on sum(weight (g(s) . a - change)^2); return its value for all rows before and after.

        action: (M, A) executed. change: (M,) c(s') - c(s). weight: (M,), of sum 1. Each step looks at `batch_size`
        rows. Raises NotFiniteError for a loss that is not finite.
        """

        def add(rows: Tensor, a: Tensor, goal: Tensor, w: Tensor, out: Tensor) -> None:
            activations = self._network.activations(self._parameters, rows)
            error = (activations[-1] * a).sum(-1) - goal
            self._network.pull(self._parameters, activations, (2 * w * error)[:, None] * a, out)

        def loss() -> float:
            error = (self._network.outputs(self._parameters, observation, pool) * action).sum(-1) - change
            return float(finite((weight * error.square()).double().sum(), "loss of a cost model"))

        before = loss()
        for rows in minibatches(len(change), batch_size, iterations, seed=self._adam.count):
            columns = [pieces(column[rows]) for column in (observation, action, change, weight)]
            self._adam.step(accumulate(pool, self._parameters, add, *columns))
        return before, loss()


class TrpoSl(Method):
    """TRPO on the proposed actions; the layer's model is fitted to the executed ones."""

    def __init__(self, config: TrpoSlConfig, problem: Problem) -> None:
        self._config, self._num_costs = config, len(problem.cost_names)
        self._signals = config.signals(problem.cost_names)
        self._limits = torch.tensor([signal.limit for signal in self._signals])
        self._warmup = shield.Warmup(config.warmup_ratio, problem.total_steps)
        network = Mlp((problem.observation_size, *config.hidden, problem.action_size))
        self._models = [CostModel(network, problem.generator, config.value_learning_rate) for _ in self._signals]

    def correct(self, observation: Tensor, costs: Tensor | None, action: Tensor) -> Tensor:
        """Return the nearest actions in the box whose next cost the model puts within the thresholds.

        Where it puts no action within them, the one of least predicted cost. Raises RunError without `costs` (N, C).
        """
        if costs is None or costs.shape != (len(action), self._num_costs):
            raise RunError(
                f"costs is {costs if costs is None else tuple(costs.shape)}: the safety layer needs those of the step "
                f"before, ({len(action)}, {self._num_costs}), zeros at an episode's start"
            )
        return self._corrected(observation, costs, action) if self._warmup.over else action

    def traceable(self) -> Correct | None:
        """Return the correction as tensor operations alone; None where the layer does not work yet."""
        return self._corrected if self._warmup.over else None

    def tensors(self) -> dict[str, Tensor]:
        """Return the models and the place in the warm-up."""
        parts = {f"model.{s.name}": model.tensors() for s, model in zip(self._signals, self._models, strict=True)}
        parts["warmup"] = self._warmup.tensors()
        return {f"{part}.{key}": tensor for part, tensors in parts.items() for key, tensor in tensors.items()}

    def improve(self, policy: GaussianPolicy, theta: Tensor, batch: Batch, pool: Executor) -> dict[str, float]:
        """Raise the surrogate return, then fit the models of the costs."""
        executed = shield.clipped(batch.rollout.executed.flatten(0, 1))
        before = self._reduced(torch.from_numpy(costs_before(batch.rollout))).flatten(0, 1)
        unmet = (self._excess(self._slopes(batch.observation), executed, before) > _ROUNDING).any(-1)
        row = shield.row(batch, self._warmup.over, unmet)
        objective = trust_region.surrogate(batch.reward_advantage, batch.log_prob)
        row |= trust_region.update(policy, theta, batch, self._config, pool, objective=objective).row()
        after = self._reduced(torch.from_numpy(batch.rollout.costs)).flatten(0, 1)
        for k, (signal, model) in enumerate(zip(self._signals, self._models, strict=True)):
            losses = model.fit(
                batch.observation,
                executed,
                after[:, k] - before[:, k],
                balanced(after[:, k] > 0),
                self._config.value_iterations,
                self._config.value_batch_size,
                pool,
            )
            row |= {f"shield_{signal.name}_loss_before": losses[0], f"shield_{signal.name}_loss_after": losses[1]}
        self._warmup.advance(len(executed))
        return row

    def _corrected(self, observation: Tensor, costs: Tensor | None, action: Tensor) -> Tensor:
        assert costs is not None
        slope, inside = self._slopes(observation), shield.clipped(action)
        excess = self._excess(slope, inside, self._reduced(costs))
        return torch.where((excess > 0).any(-1, keepdim=True), safest(inside, slope, excess), action)

    def _slopes(self, observation: Tensor) -> Tensor:
        """Return g (M, K, A)."""
        return torch.stack([model.slope(observation) for model in self._models], dim=1)

    def _reduced(self, costs: Tensor) -> Tensor:
        """Return the watched sums (..., K) of the environment's costs (..., C)."""
        return torch.stack([costs[..., list(s.columns)].sum(-1) for s in self._signals], dim=-1).float()

    def _excess(self, slope: Tensor, action: Tensor, costs: Tensor) -> Tensor:
        """Return by how much the predicted next costs (M, K) exceed their thresholds."""
        return costs + (slope * action[:, None]).sum(-1) - self._limits


_ROUNDING = 1e-5
"""Excess that single precision leaves of a constraint that the correction meets with equality."""


def safest(action: Tensor, slope: Tensor, excess: Tensor) -> Tensor:
    """Return `action` (N, A) projected onto the constraint with the largest multiplier [excess / g . g]^+.

    slope: (N, K, A) g. excess: (N, K) of the predicted cost above its threshold. Source: Dalal et al. 2018, prop. 1.
    """
    square = slope.square().sum(-1)
    multiplier = torch.where(square > 0, excess / square.clamp(min=torch.finfo(square.dtype).tiny), 0.0)
    active = multiplier.argmax(dim=-1, keepdim=True)
    normal = slope.gather(1, active[..., None].expand(-1, -1, slope.shape[-1]))[:, 0]
    return box.project(action, normal, excess.gather(-1, active)[:, 0])


def costs_before(rollout: Rollout) -> np.ndarray:
    """Return the costs (T, N, C) of the step before each step, 0 at an episode's start: what the layer was given."""
    before = np.zeros_like(rollout.costs)
    before[1:] = np.where(rollout.ended[:-1, :, None], 0.0, rollout.costs[:-1])
    return before


def balanced(positive: Tensor) -> Tensor:
    """Return weights (M,) of sum 1: the `positive` steps (M,) and the others weigh one half each, where both exist."""
    count = int(positive.sum())
    if count in (0, len(positive)):
        return torch.full((len(positive),), 1 / len(positive))
    return torch.where(positive, 0.5 / count, 0.5 / (len(positive) - count))


algorithm = OnPolicyAlgorithm(name="trpo-sl", config_type=TrpoSlConfig, method=TrpoSl, corrects=True)
