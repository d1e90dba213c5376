"""The look that all figures of GUARD share: one palette, one type size, PNG bytes out. Never opens a window."""

from __future__ import annotations

import io
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK: Final = "#1f2933"
MUTED: Final = "#67727e"
RULE: Final = "#d5dae0"
PAPER: Final = "#ffffff"

PALETTE: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours of the backends, in order. Source: Okabe and Ito 2008, distinguishable with any colour vision."""

MARKERS: Final = ("o", "s", "^", "D", "v", "P")
"""Markers of the backends, in order: a figure must also be readable in grey."""

DPI: Final = 200

STYLE: Final[dict[Any, Any]] = {
    "font.family": "DejaVu Sans",  # ships with matplotlib, so that a figure looks the same on every machine
    "font.size": 9.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": RULE,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.unicode_minus": True,
}


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure of `width` x `height` [inch] and its axes, row by row."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), facecolor=PAPER, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.flat)


def colour_of(backends: list[str], name: str) -> str:
    """Return the colour of a backend."""
    return PALETTE[backends.index(name) % len(PALETTE)]


def marker_of(backends: list[str], name: str) -> str:
    """Return the marker of a backend."""
    return MARKERS[backends.index(name) % len(MARKERS)]


def heading(axes: Axes, text: str, pad: float = 8.0) -> None:
    """Write the title of one panel."""
    axes.set_title(text, loc="left", fontsize=10.5, fontweight="bold", color=INK, pad=pad)


def plain(axes: Axes) -> None:
    """Leave only what is read: bottom rule and light horizontal lines."""
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(length=0)
    axes.grid(axis="y", color=RULE, linewidth=0.6)
    axes.set_axisbelow(True)


def png(figure: Figure) -> bytes:
    """Return the figure as PNG bytes; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()
