"""Figures of single seeds: how every training went, and what every policy got in every engine."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from guard_api.measure.figures import INK, MUTED, colour_of, heading, marker_of, new_figure, plain
from guard_api.measure.result import TransferResult
from guard_api.measure.summary import RANDOM

CURVES: Final = {"return_mean": "Return while training", "cost_mean": "Constraint cost while training"}
"""Columns of progress.csv that are drawn, with their titles."""

POINTS: Final = {"return": "Return", "cost": "Constraint cost", "violation": "Steps in violation [%]"}


def draw_training(result: TransferResult) -> Figure | None:
    """Draw the mean of every epoch's episodes over the steps, one line per run; None when nothing was logged."""
    columns = [name for name in CURVES if any(name in row for run in result.training for row in run["rows"])]
    if not columns:
        return None
    figure, axes = new_figure(9.6, 3.4, columns=len(columns))
    for ax, column in zip(axes, columns, strict=True):
        for run in result.training:
            rows = [row for row in run["rows"] if column in row]
            x, y = [row["total_steps"] for row in rows], [row[column] for row in rows]
            colour = colour_of(result.backends, run["backend"])
            ax.plot(x, y, color=colour, linewidth=0.6, alpha=0.35)
            ax.plot(x, _smooth(np.array(y)), color=colour, linewidth=1.3, alpha=0.9)
        if column == "cost_mean":
            _draw_limit(ax, result)
        plain(ax)
        heading(ax, CURVES[column])
        ax.set_xlabel("environment steps", color=MUTED)
        ax.xaxis.set_major_formatter(EngFormatter(sep=""))
        ax.xaxis.set_major_locator(MaxNLocator(5))
    _name_backends(figure, axes[0], result)
    return figure


def draw_seeds(result: TransferResult) -> Figure:
    """Draw every training seed's mean in every engine; a line joins one seed's policy across the engines."""
    figure, axes = new_figure(9.6, 3.6, columns=len(POINTS))
    for ax, (quantity, text) in zip(axes, POINTS.items(), strict=True):
        factor = 100.0 if quantity == "violation" else 1.0
        for index, source in enumerate(result.sources):
            offset = 0.16 * (index - (len(result.sources) - 1) / 2)
            x = np.arange(len(result.backends)) + offset
            y = factor * np.array([result.estimate(source, t, quantity)["per_seed"] for t in result.backends])
            colour = colour_of(result.backends, source)
            ax.plot(x, y, color=colour, linewidth=0.7, alpha=0.35)
            ax.plot(x, y, marker_of(result.backends, source), color=colour, markersize=4, alpha=0.8, markeredgewidth=0)
            ax.plot(x, y.mean(axis=1), "_", color=colour, markersize=11, markeredgewidth=2.0)
        for column, target in enumerate(result.backends):
            random = factor * result.estimate(RANDOM, target, quantity)["value"]
            ax.plot([column - 0.35, column + 0.35], [random, random], color=MUTED, linewidth=1.0, linestyle=":")
        if quantity == "cost":
            _draw_limit(ax, result)
        plain(ax)
        heading(ax, text)
        if quantity != "return":
            ax.set_ylim(bottom=0.0)
        ax.set_xticks(range(len(result.backends)), [f"in {name}" for name in result.backends])
        ax.set_xlim(-0.5, len(result.backends) - 0.5)
    axes[0].plot([], [], color=MUTED, linewidth=1.0, linestyle=":", label="random actions")
    _name_backends(figure, axes[0], result, "trained in ")
    return figure


def _name_backends(figure: Figure, ax: Axes, result: TransferResult, before: str = "") -> None:
    for name in result.sources:
        colour, marker = colour_of(result.backends, name), marker_of(result.backends, name)
        ax.plot([], [], marker=marker, color=colour, linewidth=1.3, markersize=4, label=before + name)
    figure.legend(*ax.get_legend_handles_labels(), loc="outside lower left", ncols=8, frameon=False, fontsize=8.5)


def _draw_limit(ax: Axes, result: TransferResult) -> None:
    if result.cost_limit is not None:
        ax.axhline(result.cost_limit, color=INK, linewidth=0.9, linestyle="--")
        ax.annotate(
            "limit", (1, result.cost_limit), xycoords=("axes fraction", "data"), xytext=(0, 2),
            textcoords="offset points", ha="right", va="bottom", fontsize=7.5, color=INK,
        )  # fmt: skip


def _smooth(values: np.ndarray) -> np.ndarray:
    """Return a centred moving mean over about a twentieth of the curve, with shorter windows at the ends."""
    half = len(values) // 40
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return (total[last] - total[first]) / (last - first)
