"""Early diagnosis: what goes wrong in a training, said while it runs, each with its remedy.

A pure function of the metrics rows, so that an interrupted training says the same as a whole one. Numbers that are not
finite need no rule here: they end a training with an error. The thresholds come from six million healthy steps (TRPO on
Goal_Point_8Hazards, 200 epochs of 30 episodes), from which each keeps a wide distance, and which must stay silent.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from guard_api.errors import RunError

NARROW: Final = 0.05
"""Standard deviation of an action below which a policy hardly explores: 95 % of its actions lie within a tenth of the
range [-1, 1]. The healthy run went from 0.61 to 0.18."""

STILL: Final = 1e-4
"""KL of a step [nat] below which the policy stays what it was. The healthy run's were between 0.008 and 0.02."""

STILL_EPOCHS: Final = 5
"""Epochs of that in a row: a line search may fail now and then, and the next batch is another problem."""

WINDOW: Final = 20
"""Epochs whose mean cost is compared with that of as many before: an epoch's mean cost varied by 15 %, so that a mean
of 20 is known to 3 %, the difference of two to 5 %."""

FALLING: Final = 0.95
"""Share of the cost before above which it does not fall: the difference that `WINDOW` can tell from none."""

FALLEN: Final = 0.8
"""Share of the cost at which this was said: below it the cost has fallen after all, and it may be said again."""

FAR: Final = 2.0
"""Multiple of the limit that is far above it."""

EXPLODED: Final = 10.0
"""Multiple of the median loss of the ten epochs before. It may rise with the returns, fivefold in the first epochs of
the healthy run and never more than twofold after ten of them."""

EXPLODED_EPOCHS: Final = 3
HISTORY: Final = 10

Rows = Sequence[Mapping[str, float]]
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Something that went wrong from `epoch` on. kind: its name; message: what is seen; remedy: what may help."""

    epoch: int
    kind: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f"epoch {self.epoch}: {self.message}: {self.remedy}"


def diagnose(rows: Rows, *, limits: Mapping[str, float], action_size: int) -> list[Finding]:
    """Return what went wrong, by epoch: once when it begins, and again when it comes back.

    rows: of progress.csv, oldest first; a rule whose column is missing is left out. limits: column of a mean episode
    cost -> its limit. action_size: dimensions of the action.
    """
    findings = [
        *_entropy_collapse(rows, action_size),
        *_stuck(rows),
        *(finding for column, limit in limits.items() for finding in _infeasible(rows, column, limit)),
        *(finding for column in _losses(rows) for finding in _exploding(rows, column)),
    ]
    return sorted(findings, key=lambda finding: finding.epoch)


def cost_limits(config: Any) -> dict[str, float]:
    """Return the limits in an algorithm's options, by the column of the mean episode cost; none where it has none."""
    named = getattr(config, "cost_limits", None)
    if named:
        return {f"cost_{name}": float(limit) for name, limit in named.items()}
    limit = getattr(config, "cost_limit", None)
    return {} if limit is None else {"cost_mean": float(limit)}


def to_jsonl(findings: Sequence[Finding]) -> str:
    """Return one JSON object per line."""
    return "".join(json.dumps(asdict(finding)) + "\n" for finding in findings)


def from_jsonl(file: Path) -> list[Finding]:
    """Return the findings in a file that `to_jsonl` wrote. Raises RunError for any other file."""
    try:
        return [Finding(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError, TypeError) as error:
        raise RunError(
            f"{file}: holds no findings of a diagnosis ({error}): delete it, training writes it anew"
        ) from error


def _entropy_collapse(rows: Rows, action_size: int) -> Iterator[Finding]:
    entropy = _column(rows, "entropy")
    deviation = np.exp(entropy / action_size - 0.5 * np.log(2 * np.pi * np.e))
    for k in _begins(deviation < NARROW):
        yield _finding(
            rows, k, "entropy-collapse",
            f"the policy's actions vary by {deviation[k]:.3f} only, so it hardly explores any more",
            "lower target_kl, raise initial_log_std, or stop if the return is good",
        )  # fmt: skip


def _stuck(rows: Rows) -> Iterator[Finding]:
    for k in _begins(_held(_column(rows, "kl") < STILL, STILL_EPOCHS)):
        searched = rows[k].get("line_search_steps", np.nan)
        yield _finding(
            rows, k, "policy-stuck",
            f"the policy has not moved for {STILL_EPOCHS} epochs (KL {rows[k]['kl']:.2g}, {searched:.0f} trials of the "
            "line search)",
            "raise cg_damping or steps_per_epoch, or check that rewards and costs change with the actions",
        )  # fmt: skip


def _infeasible(rows: Rows, column: str, limit: float) -> Iterator[Finding]:
    cost, told = _column(rows, column), np.inf
    for k in range(2 * WINDOW - 1, len(rows)):
        now, before = cost[k - WINDOW + 1 : k + 1].mean(), cost[k - 2 * WINDOW + 1 : k - WINDOW + 1].mean()
        far = now > FAR * limit
        if not far or now < FALLEN * told:
            told = np.inf
        if far and now > FALLING * before and told == np.inf:
            told = now
            yield _finding(
                rows, k, "limit-infeasible",
                f"{column} is {now:.3g} in the mean of {WINDOW} epochs, far above its limit of {limit:g}, and no "
                "longer falls",
                "the limit may not be reachable: raise it, or train longer with a larger target_kl or multiplier rate",
            )  # fmt: skip


def _exploding(rows: Rows, column: str) -> Iterator[Finding]:
    loss = _column(rows, column)
    ill = np.zeros(len(rows), bool)
    for k in range(HISTORY + EXPLODED_EPOCHS - 1, len(rows)):
        first = k - EXPLODED_EPOCHS + 1
        ill[k] = bool((loss[first : k + 1] > EXPLODED * np.median(loss[first - HISTORY : first])).all())
    for k in _begins(ill):
        yield _finding(
            rows, k, "value-loss-exploding",
            f"{column} has been more than {EXPLODED:g} times its former size for {EXPLODED_EPOCHS} epochs",
            "lower value_learning_rate, or check the environment for rewards or costs without bounds",
        )  # fmt: skip


def _losses(rows: Rows) -> list[str]:
    """Return the columns of the critics' losses: of the return, and of each cost."""
    names = rows[-1] if rows else {}
    return [name for name in names if name.startswith(("value_", "cost_value_")) and name.endswith("_loss_after")]


def _column(rows: Rows, name: str) -> Array:
    """Return a column (E,), NaN where a row does not have it; no comparison holds for NaN."""
    return np.array([row.get(name, np.nan) for row in rows], float)


def _held(ill: NDArray[np.bool_], epochs: int) -> NDArray[np.bool_]:
    """Return where something has been so for so many epochs in a row."""
    return np.array([k + 1 >= epochs and bool(ill[k + 1 - epochs : k + 1].all()) for k in range(len(ill))], bool)


def _begins(ill: NDArray[np.bool_]) -> list[int]:
    """Return where something begins."""
    return [k for k in range(len(ill)) if ill[k] and not (k and ill[k - 1])]


def _finding(rows: Rows, k: int, kind: str, message: str, remedy: str) -> Finding:
    return Finding(epoch=int(rows[k]["epoch"]), kind=kind, message=message, remedy=remedy)
