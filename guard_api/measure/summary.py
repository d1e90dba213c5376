"""What a transfer matrix says: every cell's means and every pair's gaps, with intervals, from the episodes alone.

J[t|s] is the mean over seeds and episodes of the policies trained in s and run in t; rand is the random policy.
Every difference and ratio is of paired episodes: the same training seed, and the same start of the same episode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from guard_api.measure.rollout import EpisodeTable
from guard_api.measure.statistics import Array, Bootstrap, Estimate, SafeRetention, Verdict, safe_retention, verdict

RANDOM: Final = "random"
"""Source name of the random policy."""

Tables: TypeAlias = Mapping[tuple[str, str], Sequence[EpisodeTable]]
"""(source, target) -> one table per training seed, in the order of the seeds."""

QUANTITIES: Final = {
    "return": lambda table: table.returns,
    "cost": lambda table: table.cost,
    "violation": lambda table: table.violation,
    "success": lambda table: table.success.astype(np.float64),
    "goals": lambda table: table.goals.astype(np.float64),
    "failed": lambda table: table.failed.astype(np.float64),
}
"""Quantity -> its value per episode (E,); the definitions are those of `EpisodeTable`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """Means of the policies trained in `source` and run in `target`.

    estimates: quantity -> estimate. costs: the mean of every named cost. verdict: of the summed cost against the
    limit, None where there is no limit.
    """

    source: str
    target: str
    estimates: dict[str, Estimate]
    costs: dict[str, Estimate]
    verdict: Verdict | None

    def to_json(self) -> dict[str, Any]:
        """Return the cell as JSON data."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Transfer:
    """What changes when the policies trained in `source` run in `target` instead of `source`.

    retention: (J_r[t|s] - J_r[t|rand]) / (J_r[s|s] - J_r[s|rand]), the share kept of the return above random.
    gaps: quantity -> J[t|s] - J[s|s], signed. safe: seeds within the cost limit here and there, None without a limit.
    """

    source: str
    target: str
    retention: Estimate
    gaps: dict[str, Estimate]
    safe: SafeRetention | None

    def to_json(self) -> dict[str, Any]:
        """Return the transfer as JSON data; safe retention as its counts and their ratio."""
        data = asdict(self)
        if self.safe is not None:
            data["safe"]["retained"] = self.safe.retained
        return data


def summarise(tables: Tables, cost_limit: float | None) -> tuple[list[Cell], list[Transfer]]:
    """Return every cell and every change of backend in a complete matrix, the random policy's row included.

    Raises ValueError when tables that must be paired are not of the same episodes.
    """
    _require_pairs(tables)
    first = next(iter(tables.values()))
    bootstrap = Bootstrap(len(first), first[0].episodes)
    cells = [_cell(source, target, rows, bootstrap, cost_limit) for (source, target), rows in tables.items()]
    pairs = [(s, t) for s, t in tables if s not in (t, RANDOM)]
    transfers = [_transfer(s, t, tables, bootstrap, cost_limit) for s, t in pairs]
    return cells, transfers


def _cell(
    source: str, target: str, tables: Sequence[EpisodeTable], bootstrap: Bootstrap, cost_limit: float | None
) -> Cell:
    names = tables[0].cost_names
    return Cell(
        source=source,
        target=target,
        estimates={name: bootstrap.mean(_values(tables, name)) for name in QUANTITIES},
        costs={
            name: bootstrap.mean(np.stack([table.costs[:, column] for table in tables]))
            for column, name in enumerate(names)
        },
        verdict=None if cost_limit is None else verdict(_values(tables, "cost"), cost_limit, bootstrap),
    )


def _transfer(s: str, t: str, tables: Tables, bootstrap: Bootstrap, cost_limit: float | None) -> Transfer:
    there, here = tables[s, t], tables[s, s]
    above_there = _values(there, "return") - _values(tables[RANDOM, t], "return")
    above_here = _values(here, "return") - _values(tables[RANDOM, s], "return")
    costs = _values(here, "cost"), _values(there, "cost")
    return Transfer(
        source=s,
        target=t,
        retention=bootstrap.ratio(above_there, above_here),
        gaps={name: bootstrap.mean(_values(there, name) - _values(here, name)) for name in QUANTITIES},
        safe=None if cost_limit is None else safe_retention(*costs, cost_limit),
    )


def _values(tables: Sequence[EpisodeTable], quantity: str) -> Array:
    """Return a quantity of every seed and episode: (K, E)."""
    return np.stack([QUANTITIES[quantity](table) for table in tables])


def _require_pairs(tables: Tables) -> None:
    streams = {
        name: [(table.seed, table.num_worlds, table.episodes, table.cost_names) for table in rows]
        for name, rows in tables.items()
    }
    (first, expected), *others = streams.items()
    for name, found in others:
        if found != expected:
            raise ValueError(f"cells {first} and {name} are not of the same episodes: {expected} and {found}")
