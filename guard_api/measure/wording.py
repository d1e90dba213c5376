"""A transfer result in plain words: numbers as text, the headline, one sentence per pair, and what to beware of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from guard_api.measure.result import TransferResult
from guard_api.measure.statistics import ADVISED_SEEDS, MIN_SEEDS

Estimate = Mapping[str, Any]

PERCENT: Final = frozenset({"violation", "success", "failed", "retention"})
"""Quantities that are shares, shown in per cent."""

ALGORITHMS: Final = {
    "cpo": "CPO",
    "pcpo": "PCPO",
    "trpo": "TRPO",
    "trpo-fac": "TRPO-FAC",
    "trpo-ipo": "TRPO-IPO",
    "trpo-lagrangian": "TRPO-Lagrangian",
}


def number(value: float, like: float | None = None, signed: bool = False) -> str:
    """Return `value` with about three significant digits; with as many decimals as `like` would get, if given."""
    size = abs(value if like is None else like)
    decimals = 0 if size >= 100 else 1 if size >= 10 else 2 if size >= 0.095 or size == 0 else 3
    text = f"{value:{'+' if signed else ''},.{decimals}f}"
    if float(text.replace(",", "")) == 0.0:
        text = text.lstrip("+-")
    return text.replace("-", "−")


def value_text(quantity: str, estimate: Estimate, signed: bool = False) -> str:
    """Return the estimate's value as text; a signed one is a change, that of a share in percentage points."""
    if estimate["value"] is None:
        return "undefined"
    unit = ("\u202fpp" if signed else "\u202f%") if quantity in PERCENT else ""
    return number(_scaled(quantity, estimate["value"]), signed=signed) + unit


def interval_text(quantity: str, estimate: Estimate, signed: bool = False) -> str:
    """Return the 95 % interval as text, or "" where there is none."""
    if estimate["value"] is None or estimate["low"] is None:
        return ""
    low, high, like = (_scaled(quantity, estimate[name]) for name in ("low", "high", "value"))
    like = max(abs(like), (high - low) / 3)  # no more digits than the interval's width deserves
    return f"[{number(low, like, signed)}, {number(high, like, signed)}]"


def title(result: TransferResult) -> str:
    """Return what was measured, in one line."""
    seeds, backends = len(result.seeds), len(result.backends)
    return (
        f"{result.manifest['env']} · {algorithm_name(result)} · {backends} engine{'s' * (backends > 1)} · "
        f"{seeds} seed{'s' * (seeds > 1)} × {result.episodes} episodes"
    )


def algorithm_name(result: TransferResult) -> str:
    """Return the algorithm as it is written in papers."""
    name = str(result.manifest["algorithm"])
    return ALGORITHMS.get(name, name)


def pair_sentence(result: TransferResult, transfer: Mapping[str, Any]) -> str:
    """Return what happens to a policy trained in one engine when it runs in another."""
    source, target = transfer["source"], transfer["target"]
    costs = [number(result.estimate(source, where, "cost")["value"]) for where in (source, target)]
    cost = (
        f"its constraint cost stays at {costs[0]}"
        if costs[0] == costs[1]
        else f"its constraint cost changes from {costs[0]} to {costs[1]}"
    )
    return f"A policy trained in {source} {_return_phrase(result, transfer)} and {cost} in {target}."


def headline(result: TransferResult) -> tuple[str, str]:
    """Return the sentence for the pair with the largest rise of cost, and one that says what it stands for."""
    if not result.transfers:
        only = result.sources[0]
        gained, cost = (value_text(name, result.estimate(only, only, name)) for name in ("return", "cost"))
        return (
            f"Policies trained in {only} reach a return of {gained} at a constraint cost of {cost}.",
            "There is one engine only, so nothing was transferred.",
        )
    worst = max(result.transfers, key=lambda transfer: transfer["gaps"]["cost"]["value"])
    gap = worst["gaps"]["cost"]
    interval = interval_text("cost", gap, signed=True)
    count = len(result.transfers)
    largest = f"Of {count} changes of engine this is the one whose cost rises most"
    if gap["value"] <= 0.0:
        largest = f"In none of the {count} changes of engine the cost rises; this is the one where it falls least"
    detail = f"{largest}: by {value_text('cost', gap, signed=True)} per episode"
    detail += f", 95\u202f% interval {interval}" if interval else f" ({gap['reason']})"
    detail += ", which holds zero." if interval and gap["low"] <= 0.0 <= gap["high"] else "."
    return pair_sentence(result, worst), detail


def caveats(result: TransferResult) -> list[str]:
    """Return what a careful reader should know before believing the numbers."""
    return [
        _seeds_caveat(result),
        "An interval that holds zero does not show that two engines agree; it shows that these data cannot tell them "
        "apart. The intervals are not adjusted for the number of comparisons in the table.",
        "A gap says that two engines differ for these policies, not which of them is closer to the world.",
        f"Every policy is the last one of its training of {result.manifest['total_steps']:,} steps, never one "
        "picked by its results, and acts without exploration noise.",
        _failures_caveat(result),
        *_limit_caveat(result),
        *(
            f"{engine} approximates: {sentence}"
            for engine, sentences in result.manifest["approximations"].items()
            for sentence in sentences
        ),
    ]


def _return_phrase(result: TransferResult, transfer: Mapping[str, Any]) -> str:
    retention = transfer["retention"]["value"]
    if retention is None:
        source, target = transfer["source"], transfer["target"]
        here, there = (number(result.estimate(source, where, "return")["value"]) for where in (source, target))
        return f"keeps its return at {here}" if here == there else f"changes its return from {here} to {there}"
    lost = 100.0 * (1.0 - retention)
    share = number(abs(lost), like=max(abs(lost), 10.0)) if abs(lost) < 10 else f"{abs(lost):.0f}"
    if float(share) == 0.0:
        return "keeps its return"
    return f"{'loses' if lost > 0 else 'gains'} {share}\u202f% of its return"


def _seeds_caveat(result: TransferResult) -> str:
    seeds = len(result.seeds)
    if seeds < MIN_SEEDS:
        return (
            f"{seeds} training seed{'s' * (seeds > 1)}: the numbers are points without intervals, because no interval "
            f"is given below {MIN_SEEDS} seeds. Another seed may give another answer."
        )
    coverage = {int(k): value for k, value in result.manifest["bootstrap"]["coverage"].items()}
    known = max((k for k in coverage if k <= seeds), default=min(coverage))
    text = (
        f"{seeds} training seeds. Where seeds differ much more than episodes, a nominal 95\u202f% interval of this "
        f"kind from {known} seeds held the truth in {100 * coverage[known]:.0f}\u202f% of simulated experiments"
    )
    if seeds < ADVISED_SEEDS:
        return text + f": these are too narrow. Use at least {ADVISED_SEEDS} seeds, better 10, for a claim."
    return text + "; 10 seeds or more are better for a claim."


def _failures_caveat(result: TransferResult) -> str:
    failed = sum(len(run["episodes"]["failures"]) for cell in result.cells for run in cell["runs"])
    played = len(result.cells) * len(result.seeds) * result.episodes
    if not failed:
        return f"None of the {played:,} episodes ended in diverged physics or an invalid action."
    return (
        f"{failed:,} of {played:,} episodes failed (diverged physics or an invalid action). They are "
        "counted: they keep the return scored until then, and each step that they missed costs 1 and is a violation."
    )


def _limit_caveat(result: TransferResult) -> list[str]:
    if result.cost_limit is None:
        return ["There is no cost limit, so nothing is called safe or unsafe."]
    limit = f"{result.cost_limit:g}"
    text = (
        f"The cost limit is {limit} per episode. A cell is called safe when the upper one-sided 95\u202f% bound of its "
        f"mean cost is at most {limit}, unsafe when the lower one is above it, and undecided otherwise"
    )
    if len(result.seeds) < MIN_SEEDS:
        text += f" (always, below {MIN_SEEDS} seeds)"
    return [text + "."]


def _scaled(quantity: str, value: float) -> float:
    return 100.0 * value if quantity in PERCENT else value
