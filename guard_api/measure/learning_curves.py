"""Learning curves: what every algorithm's training looked like, the mean over its seeds with an interval."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

import guard_api
from guard_api.measure.figures import MUTED, PALETTE, heading, new_figure, plain, png
from guard_api.measure.learning import Group, by_environment
from guard_api.measure.scores import notes, score, table
from guard_api.measure.statistics import CONFIDENCE, MIN_SEEDS, Bootstrap
from guard_api.measure.tables import table as html_table
from guard_api.runs.atomic import write_bytes, write_text

PANELS: Final = {
    "return_mean": "Return",
    "cost_mean": "Constraint cost",
    "cost_rate": "Cost rate so far",
    "violation_rate": "Steps in violation [%]",
}
"""Columns of progress.csv that are drawn, with their titles."""

STYLES: Final = ("-", "--", ":", "-.")
"""Line styles, one for every round through the palette."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """Means (E,) over seeds after `steps` (E,), with the bounds of their 95 % intervals, None below three seeds."""

    steps: Array
    mean: Array
    low: Array | None
    high: Array | None


def curve(group: Group, column: str) -> Curve:
    """Return a column's mean over the group's seeds at every epoch, with pointwise percentile bootstrap intervals."""
    values = group.values(column)
    low = high = None
    if len(values) >= MIN_SEEDS:
        bootstrap, tail = Bootstrap(len(values), 1), (1.0 - CONFIDENCE) / 2.0
        bounds = [np.quantile(bootstrap.means(one[:, None]), [tail, 1.0 - tail]) for one in values.T]
        low, high = np.array(bounds).T
    return Curve(steps=group.steps, mean=values.mean(axis=0), low=low, high=high)


def draw_curves(groups: Sequence[Group]) -> Figure:
    """Draw the groups of one environment: a panel for each column, a line for each group.

    Below three seeds the seeds are thin lines behind their mean.
    """
    figure, axes = new_figure(12.8, 3.4, columns=len(PANELS))
    for ax, (column, title) in zip(axes, PANELS.items(), strict=True):
        factor = 100.0 if column == "violation_rate" else 1.0
        for index, group in enumerate(groups):
            _draw(ax, group, column, factor, index)
        plain(ax)
        heading(ax, title)
        if column != "return_mean":
            ax.set_ylim(bottom=0.0)
        ax.set_xlabel("environment steps", color=MUTED)
        ax.xaxis.set_major_formatter(EngFormatter(sep=""))
        ax.xaxis.set_major_locator(MaxNLocator(4))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=6, frameon=False, fontsize=8.5)
    return figure


def write_curves(groups: Sequence[Group], out: Path) -> list[Path]:
    """Write `curves_{env}.png` of every environment and `curves.html` with all of them to the folder `out`."""
    figures = {env: png(draw_curves(members)) for env, members in by_environment(groups).items()}
    files = []
    for env, data in figures.items():
        files.append(out / f"curves_{env}.png")
        write_bytes(files[-1], data)
    files.append(out / "curves.html")
    write_text(files[-1], render(groups, figures))
    return files


def render(groups: Sequence[Group], figures: dict[str, bytes]) -> str:
    """Return one HTML document that refers to nothing outside itself. figures: environment -> PNG."""
    css = (resources.files("guard_api.measure") / "report.css").read_text()
    scores = score(groups, {})
    body = [f"<header><p class='what'>{escape(', '.join(figures))}</p><h1>Learning curves</h1></header>"]
    for env, members in by_environment(scores).items():
        head, *rows = table(members)
        image = base64.b64encode(figures[env]).decode()
        body.append(
            f"<section><h2>{escape(env)}</h2><img alt='Learning curves in {escape(env)}' "
            f"src='data:image/png;base64,{image}'>"
            + html_table(head, [("", [escape(cell) for cell in row]) for row in rows], names=2)
            + "</section>"
        )
    lead = "Mean over seeds of every epoch's training episodes, actions sampled; shaded, its pointwise 95 % bootstrap "
    lead += "interval over seeds. J_r, M_c: mean return and cost of the last epoch; rho_c: cost per step of all epochs."
    facts = [lead, *notes(scores), *(_settings(group) for group in groups)]
    items = "".join(f"<li>{escape(text)}</li>" for text in facts)
    body.append(f"<section><h2>What is drawn</h2><ul class='caveats'>{items}</ul></section>")
    return (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n<title>Learning curves</title>\n"
        f"<link rel='icon' href='data:,'>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(body)
        + f"\n<footer>GUARD {escape(guard_api.__version__)}</footer>\n</main>\n</body>\n</html>\n"
    )


def _draw(ax: Axes, group: Group, column: str, factor: float, index: int) -> None:
    colour, style = PALETTE[index % len(PALETTE)], STYLES[index // len(PALETTE) % len(STYLES)]
    drawn = curve(group, column)
    if drawn.low is not None and drawn.high is not None:
        ax.fill_between(drawn.steps, factor * drawn.low, factor * drawn.high, color=colour, alpha=0.18, linewidth=0)
    elif len(group.runs) > 1:
        ax.plot(drawn.steps, factor * group.values(column).T, color=colour, linewidth=0.6, alpha=0.4)
    label = f"{group.label}, {group.backend} ({len(group.runs)})"
    ax.plot(drawn.steps, factor * drawn.mean, style, color=colour, linewidth=1.3, label=label)


def _settings(group: Group) -> str:
    """Return where a group's runs come from: seeds, preset, versions."""
    manifest = group.runs[0].manifest
    preset = manifest.get("preset")
    text = f"{group.env}, {group.label} in {group.backend}: seeds {', '.join(map(str, group.seeds))}"
    if preset:
        changed = f", changed: {', '.join(preset['changed'])}" if preset["changed"] else ""
        text += f"; preset {preset['name']}{changed}"
    versions = {f"{name} {version}" for run in group.runs for name, version in run.manifest["versions"].items()}
    return f"{text}; {', '.join(sorted(versions))}"
