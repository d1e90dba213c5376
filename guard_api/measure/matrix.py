"""`matrix.png`: return, cost and violations of every policy in every engine, at one glance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from guard_api.measure.figures import INK, MUTED, PAPER, RULE, heading, new_figure, png
from guard_api.measure.result import TransferResult, read_result
from guard_api.measure.summary import RANDOM
from guard_api.measure.wording import interval_text, title, value_text
from guard_api.runs.atomic import write_bytes

RANDOM_FILL: Final = "#eef0f3"
GAP: Final = 0.3  # between the matrix and the row of the random policy, in cells


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One quantity: its name in the data, its title, what is better, and the darkest colour of its scale."""

    quantity: str
    title: str
    better: str
    colour: str


PANELS: Final = (
    Panel(quantity="return", title="Return", better="higher is better", colour="#5ba3d9"),
    Panel(quantity="cost", title="Constraint cost", better="lower is better", colour="#f0a04b"),
    Panel(quantity="violation", title="Steps in violation", better="lower is better", colour="#c49bc9"),
)
"""Light single-hue scales: dark text stays readable on all of them, and they keep their order in grey."""


def draw_matrix(result: TransferResult, titled: bool = True) -> Figure:
    """Draw one heat map per quantity: rows are where a policy was trained, columns where it runs."""
    rows, columns = len(result.sources), len(result.backends)
    width = len(PANELS) * (columns * 1.08 + 0.25) + 0.8
    figure, axes = new_figure(width, (rows + 1 + GAP) * 0.74 + 0.85 + 0.25 * titled, columns=len(PANELS))
    for index, (panel, ax) in enumerate(zip(PANELS, axes, strict=True)):
        _draw_panel(result, panel, ax, first=index == 0)
    if titled:
        figure.suptitle(f"{title(result)}\n", x=0.008, ha="left", fontsize=9.5, color=MUTED)
    return figure


def write_matrix(out: Path | str) -> Path:
    """Write `matrix.png` into the folder of a finished transfer.json. Raises RunError as `read_result` does."""
    path = Path(out) / "matrix.png"
    write_bytes(path, png(draw_matrix(read_result(out))))
    return path


def _draw_panel(result: TransferResult, panel: Panel, ax: Axes, first: bool) -> None:
    backends, sources = result.backends, result.sources
    size = len(sources)
    scale = _scale(result, panel)
    shades = LinearSegmentedColormap.from_list(panel.quantity, [PAPER, panel.colour])
    for column, target in enumerate(backends):
        for row, source in enumerate(sources):
            estimate = result.estimate(source, target, panel.quantity)
            _draw_cell(ax, column, row, shades(scale(estimate["value"])))
            verdict = result.cell(source, target)["verdict"] if panel.quantity == "cost" else None
            _write_cell(ax, column, row, panel.quantity, estimate, verdict)
        _draw_cell(ax, column, size + GAP, RANDOM_FILL)
        _write_cell(ax, column, size + GAP, panel.quantity, result.estimate(RANDOM, target, panel.quantity), None)
    for row, source in enumerate(sources):
        ax.add_patch(Rectangle((backends.index(source), row), 1, 1, fill=False, edgecolor=INK, linewidth=1.4, zorder=3))
    ax.set_xlim(-0.02, len(backends) + 0.02)
    ax.set_ylim(size + 1 + GAP + 0.02, -0.02)
    ax.set_xticks(np.arange(len(backends)) + 0.5, backends)
    ax.xaxis.tick_top()
    ax.set_yticks([*(np.arange(size) + 0.5), size + GAP + 0.5], [*sources, "random\nactions"] if first else [])
    ax.tick_params(length=0, labelsize=9)
    for spine in ax.spines.values():
        spine.set_visible(False)
    heading(ax, panel.title, pad=40)
    ax.annotate(
        f"run in …  ({panel.better})", (0, 1), xytext=(0, 23), xycoords="axes fraction",
        textcoords="offset points", fontsize=8, color=MUTED,
    )  # fmt: skip
    if first:
        ax.set_ylabel("trained in …", color=MUTED, fontsize=8, y=1.0 - size / 2 / (size + 1 + GAP))


def _scale(result: TransferResult, panel: Panel) -> Normalize:
    """Return the colour scale: from zero for costs, from the random policy (or the worst cell) for the return."""
    backends = result.backends
    values = [result.estimate(s, t, panel.quantity)["value"] for s in result.sources for t in backends]
    floor = 0.0
    if panel.quantity == "return":
        floor = min(values + [result.estimate(RANDOM, t, "return")["value"] for t in backends])
    return Normalize(floor, max(values) if max(values) > floor else floor + 1.0)


def _draw_cell(ax: Axes, column: float, row: float, colour: str | tuple[float, float, float, float]) -> None:
    ax.add_patch(Rectangle((column, row), 1, 1, facecolor=colour, edgecolor=RULE, linewidth=0.8))


def _write_cell(ax: Axes, column: float, row: float, quantity: str, estimate: dict, verdict: str | None) -> None:
    interval = interval_text(quantity, estimate)
    lines = 1 + bool(interval) + bool(verdict)
    top = row + 0.5 - 0.13 * (lines - 1)
    style: dict[str, Any] = {"ha": "center", "va": "center", "color": INK}
    x = column + 0.5
    ax.text(x, top, value_text(quantity, estimate), fontsize=11, weight="bold", **style)
    if interval:
        ax.text(x, top + 0.27, interval, fontsize=7.5, **style)
    if verdict:
        ax.text(x, row + 0.56 + 0.13 * (lines - 1), verdict, fontsize=7.5, style="italic", **style)
