"""`report.html`: a transfer result for people. One file, readable offline, made from transfer.json alone."""

from __future__ import annotations

import base64
from html import escape
from importlib import resources
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

import guard_api
from guard_api.measure.curves import draw_seeds, draw_training
from guard_api.measure.figures import png
from guard_api.measure.matrix import draw_matrix, write_matrix
from guard_api.measure.result import TransferResult, read_result
from guard_api.measure.statistics import ADVISED_SEEDS
from guard_api.measure.tables import cell_table, fact_table, pair_table, seed_table
from guard_api.measure.wording import caveats, headline, pair_sentence, title
from guard_api.runs.atomic import write_text

DEFINITIONS: Final = {
    "Return": "Sum of the rewards of an episode, averaged over episodes and seeds.",
    "Constraint cost": "Sum of all costs of an episode, averaged likewise.",
    "Steps in violation": "Share of an episode's steps in which any cost is above zero.",
    "Success": "Share of the episodes in which at least one goal was achieved.",
    "Return kept": "(return there − random policy's return there) ÷ (return at home − random policy's return at home), "
    "of the same policies: 100 % means that the move costs nothing. Undefined where the policies are not clearly "
    "better than random actions at home. “Loses 3 % of its return” means 97 % kept.",
    "Change": "There minus at home, with sign (pp: percentage points), over pairs: the same policy, and the same start "
    "of the same episode. What an episode's layout does to both engines alike cancels.",
    "Interval": "95 % percentile interval of a bootstrap that draws training seeds, and within them episodes, with the "
    "same draws in every engine.",
    "Seeds still safe": "Of the seeds whose policy keeps within the cost limit at home, how many do so there too.",
    "Random actions": "Uniform actions, the same in every engine: what a policy that learned nothing gets.",
}


def write_report(out: Path | str) -> Path:
    """Write `report.html`, and `matrix.png` beside it, from the transfer.json in the folder `out`; return its path.

    Raises RunError as `read_result` does, or when the disk is full.
    """
    result = read_result(out)
    write_matrix(out)
    path = Path(out) / "report.html"
    write_text(path, render(result))
    return path


def render(result: TransferResult) -> str:
    """Return the report as one HTML document that refers to nothing outside itself."""
    css = (resources.files("guard_api.measure") / "report.css").read_text()
    body = [_header(result), _matrix(result), _pairs(result), _seeds(result), _training(result)]
    body += [_definitions(), _caveats(result), _facts(result)]
    return (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(title(result))}</title>\n<link rel='icon' href='data:,'>\n<style>\n{css}</style>\n</head>\n"
        "<body>\n<main>\n" + "\n".join(part for part in body if part) + "\n"
        f"<footer>GUARD {escape(guard_api.__version__)}. All numbers are in transfer.json, "
        "per seed and per episode.</footer>\n</main>\n</body>\n</html>\n"
    )


def _header(result: TransferResult) -> str:
    sentence, detail = headline(result)
    warning = ""
    if len(result.seeds) < ADVISED_SEEDS:
        warning = f"<p class='warning'>{escape(caveats(result)[0])}</p>"
    return (
        f"<header><p class='what'>{escape(title(result))}</p><h1>{escape(sentence)}</h1>"
        f"<p class='detail'>{escape(detail)}</p>{warning}</header>"
    )


def _matrix(result: TransferResult) -> str:
    lead = "Rows: where the policies were trained. Columns: where they ran. Outlined: at home. "
    lead += "Below each mean its 95 % interval." if len(result.seeds) > 2 else ""
    return _section(
        "Every policy in every engine", lead, _image(draw_matrix(result, titled=False), "Transfer matrices")
    )


def _pairs(result: TransferResult) -> str:
    if not result.transfers:
        return _section("All cells", "Means over seeds and episodes.", cell_table(result))
    sentences = "".join(f"<li>{escape(pair_sentence(result, transfer))}</li>" for transfer in result.transfers)
    return _section(
        "What changes when a policy moves",
        "There minus at home, for the same policies on the same episodes.",
        pair_table(result)
        + f"<details><summary>In words</summary><div><ul class='pairs'>{sentences}</ul></div></details>"
        + f"<details><summary>All cells</summary><div>{cell_table(result)}</div></details>",
    )


def _seeds(result: TransferResult) -> str:
    return _section(
        "Every seed",
        "A mark is the mean of one trained policy in one engine; a line joins the same policy; a bar is the mean over "
        "seeds; dotted, random actions.",
        _image(draw_seeds(result), "Return, cost and violations of every seed in every engine")
        + f"<details><summary>As a table</summary><div>{seed_table(result)}</div></details>",
    )


def _training(result: TransferResult) -> str:
    figure = draw_training(result)
    if figure is None:
        return ""
    lead = "Means of every epoch's episodes with exploring actions; thick, their moving mean. One line per run."
    return _section("How the policies were trained", lead, _image(figure, "Training curves of every run"))


def _definitions() -> str:
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in DEFINITIONS.items())
    return _section("What the numbers mean", "", f"<dl>{rows}</dl>")


def _caveats(result: TransferResult) -> str:
    items = "".join(f"<li>{escape(text)}</li>" for text in caveats(result))
    return _section("Before you believe them", "", f"<ul class='caveats'>{items}</ul>")


def _facts(result: TransferResult) -> str:
    return _section("How to get them again", "What decided every number on this page.", fact_table(result))


def _section(heading: str, lead: str, content: str) -> str:
    lead = f"<p class='lead'>{escape(lead)}</p>" if lead else ""
    return f"<section><h2>{escape(heading)}</h2>{lead}{content}</section>"


def _image(figure: Figure, text: str) -> str:
    data = base64.b64encode(png(figure)).decode()
    return f"<img alt='{escape(text)}' src='data:image/png;base64,{data}'>"
