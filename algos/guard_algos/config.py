"""Options of the on-policy algorithms: each field is a command-line option whose default is GUARD's published value."""

from __future__ import annotations

from dataclasses import dataclass, field

from guard_api.errors import SpecError


@dataclass(frozen=True, kw_only=True)
class OnPolicyConfig:
    """Options that every on-policy trust-region algorithm shares.

    Source of the defaults: Zhao et al. 2024 (GUARD), Table 19 and released code. Where its text differs from both
    (advantage discount 0.95, learning rate 0.01), the released code is followed, because it made the numbers.
    """

    steps_per_epoch: int = 30_000
    """Least environment steps per update, rounded up to whole episodes of every world."""
    gamma: float = 0.99
    """Discount of reward and cost."""
    gae_lambda: float = 0.97
    """Exponential weight of the generalised advantage estimate."""
    hidden: tuple[int, ...] = (64, 64)
    """Widths of the tanh layers of every network."""
    initial_log_std: float = -0.5
    """Initial log standard deviation of every action; it is learned and does not depend on the observation."""
    target_kl: float = 0.02
    """Trust-region radius: largest mean KL(old || new) of one update [nat]."""
    backtrack_factor: float = 0.8
    """Factor by which the line search shrinks the step."""
    backtrack_steps: int = 100
    """Trials of the line search before the old policy is kept."""
    value_iterations: int = 80
    """Full-batch Adam steps on each critic per epoch."""
    value_learning_rate: float = 1e-3
    """Adam learning rate of the critics."""
    cg_iterations: int = 30
    """Most conjugate-gradient iterations per solve, on the full batch."""
    cg_tolerance: float = 1e-2
    """Relative residual at which conjugate gradient stops; on Goal_Point_8Hazards after 10 to 20 iterations."""
    cg_damping: float = 0.1
    """Multiple of the identity added to the Fisher matrix. GUARD's code has none and iterates up to 100 times; on
    Goal_Point_8Hazards that leaves a residual of 0.04 to 0.3 and steps whose KL is 30 to 200 times what their quadratic
    model says, because they run far along directions that no sample excites. With 0.1 the two agree within 40 %."""
    checkpoint_every: int = 10
    """Epochs between checkpoints; the last epoch always leaves one."""
    threads: int = 2
    """CPU threads of the update. It changes no number."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        for name in ("steps_per_epoch", "backtrack_steps", "cg_iterations", "checkpoint_every", "threads"):
            _require(self, name, getattr(self, name) >= 1, "must be at least 1")
        for name in ("target_kl", "value_learning_rate"):
            _require(self, name, getattr(self, name) > 0, "must be positive")
        for name in ("gamma", "gae_lambda"):
            _require(self, name, 0 <= getattr(self, name) <= 1, "must lie in [0, 1]")
        for name in ("value_iterations", "cg_tolerance", "cg_damping"):
            _require(self, name, getattr(self, name) >= 0, "must not be negative")
        _require(self, "backtrack_factor", 0 < self.backtrack_factor < 1, "must lie between 0 and 1")
        _require(self, "hidden", all(width >= 1 for width in self.hidden), "must hold positive widths")


@dataclass(frozen=True, kw_only=True)
class CostLimits:
    """Which costs are constrained, and how much of each an episode may hold: the undiscounted sum over its steps."""

    cost_limit: float = 0.0
    """Limit of the sum of all costs of an episode, where `cost_limits` is empty."""
    cost_limits: dict[str, float] = field(default_factory=dict)
    """Limits of named costs, each with its own critic, advantage and multiplier; the other costs are only logged."""


def _require(config: object, name: str, holds: bool, rule: str) -> None:
    if not holds:
        raise SpecError(f"{name} = {getattr(config, name)}: {rule}")
