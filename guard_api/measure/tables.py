"""The report's tables as HTML: every cell, every pair, every seed and every fact of the manifest."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from guard_api.measure.result import TransferResult
from guard_api.measure.summary import RANDOM
from guard_api.measure.wording import interval_text, number, value_text


def table(head: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]], names: int = 1) -> str:
    """Return a table. rows: (class, cells), cells already HTML; the first `names` columns are text, flush left."""
    lines = ["<div class='wide'><table>", _row("th", "", [escape(text) for text in head], names)]
    lines += [_row("td", kind, cells, names) for kind, cells in rows]
    return "\n".join([*lines, "</table></div>"])


def pair_table(result: TransferResult) -> str:
    """Return what changes for the policies of every source in every other engine."""
    head = ["trained in", "run in", "return kept"]
    head += [f"{name} change" for name in ("return", "cost", "violation", "success")]
    if result.cost_limit is not None:
        head.append("seeds still safe")
    rows = []
    for transfer in result.transfers:
        gaps = transfer["gaps"]
        cells = [escape(transfer["source"]), escape(transfer["target"]), _number("retention", transfer["retention"])]
        cells += [_number(name, gaps[name], signed=True) for name in ("return", "cost", "violation", "success")]
        if result.cost_limit is not None:
            cells.append(_safe(transfer["safe"]))
        rows.append(("", cells))
    return table(head, rows, names=2)


def cell_table(result: TransferResult) -> str:
    """Return the means of every policy in every engine, the random policy last."""
    columns = {"return": "return", "cost": "constraint cost", "violation": "steps in violation", "success": "success"}
    columns |= {"goals": "goals per episode", "failed": "failed episodes"}
    many = len(result.cost_names) > 1
    head = ["trained in", "run in", *columns.values(), *(result.cost_names if many else [])]
    if result.cost_limit is not None:
        head.append("verdict")
    rows = []
    for cell in result.cells:
        kind = "random" if cell["source"] == RANDOM else "native" if cell["source"] == cell["target"] else ""
        source = "random actions" if cell["source"] == RANDOM else cell["source"]
        cells = [escape(source), escape(cell["target"])]
        cells += [_number(name, cell["estimates"][name]) for name in columns]
        if many:
            cells += [_number("cost", cell["costs"][name]) for name in result.cost_names]
        if result.cost_limit is not None:
            cells.append(f"<span class='verdict {cell['verdict']}'>{cell['verdict']}</span>")
        rows.append((kind, cells))
    return table(head, rows, names=2)


def seed_table(result: TransferResult) -> str:
    """Return the mean return and cost of every single policy in every engine."""
    head = ["trained in", "seed", *(f"{text} in {t}" for t in result.backends for text in ("return", "cost"))]
    rows = []
    for source in result.sources:
        for index, seed in enumerate(result.seeds):
            cells = [escape(source), str(seed)]
            for target in result.backends:
                for quantity in ("return", "cost"):
                    cells.append(number(result.estimate(source, target, quantity)["per_seed"][index]))
            rows.append(("", cells))
    return table(head, rows, names=2)


def fact_table(result: TransferResult) -> str:
    """Return everything that decides the numbers, from the manifest."""
    manifest = result.manifest
    commits = manifest.get("commits", [manifest["git"]])
    facts = {
        "command": manifest["command"],
        "measured": manifest["started"],
        "environment": f"{manifest['env']} (fingerprint {manifest['spec_fingerprint']})",
        "specification": manifest["spec"],
        "algorithm": manifest["algorithm"],
        "options": manifest["config"],
        "training": f"{manifest['total_steps']:,} steps in {manifest['num_worlds']} worlds, seeds "
        f"{_list(result.seeds)}",
        "evaluation": f"{manifest['episodes']} episodes in {manifest['eval_worlds']} worlds per policy and engine, "
        f"streams {manifest['evaluation_seed']} + training seed",
        "intervals": f"{manifest['bootstrap']['replicates']:,} bootstrap replicates over seeds, then episodes; paired",
        "engines": manifest["engines"],
        "versions": manifest["versions"],
        "commits": commits if any(commits) else None,
        "machine": manifest["hardware"],
        "platform": manifest["platform"],
        "robot files": manifest["assets"],
        "plan fingerprint": manifest["plan_fingerprint"],
    }
    rows = "\n".join(f"<tr><td>{escape(name)}</td><td>{_fact(value)}</td></tr>" for name, value in facts.items())
    return f"<table class='facts'>{rows}</table>"


def _row(tag: str, kind: str, cells: Sequence[str], names: int) -> str:
    inside = "".join(
        f"<{tag} class='name'>{cell}</{tag}>" if index < names else f"<{tag}>{cell}</{tag}>"
        for index, cell in enumerate(cells)
    )
    return f"<tr class='{kind}'>{inside}</tr>" if kind else f"<tr>{inside}</tr>"


def _number(quantity: str, estimate: Mapping[str, Any], signed: bool = False) -> str:
    interval = interval_text(quantity, estimate, signed)
    text = escape(value_text(quantity, estimate, signed))
    return f"{text}<span class='interval'>{escape(interval)}</span>" if interval else text


def _safe(counts: Mapping[str, Any]) -> str:
    safe = counts["both"] + counts["source_only"]
    return f"{counts['both']} of {safe}" if safe else "none safe at home"


def _fact(value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, str):
        return f"<code>{escape(value)}</code>"
    return f"<code>{escape(json.dumps(value, sort_keys=True))}</code>"


def _list(values: Sequence[int]) -> str:
    return ", ".join(str(value) for value in values)
