"""The tables of the page on robots: from the records of `guard_api.measure.cells`, into the marked parts of a text.

A part begins with `<!-- begin NAME -->` and ends with `<!-- end NAME -->`; all other text is left as it is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from guard_api.errors import RunError
from guard_api.measure.cells import read_records
from guard_api.measure.divergence import median_time
from guard_api.measure.locomotion import QUANTITIES, differs, interval
from guard_api.measure.targets import FIGURES, NEAR, Figure

Records = Sequence[Mapping[str, Any]]

MEASURES: Final = ("conformance", "targets", "divergence", "locomotion", "endurance", "bench")
"""The measurements, each in a file and a part of the page of its name."""

CROWDED: Final = "no free place"
"""How the reason begins that ends an episode without a fault of the physics. Source: `guard_api.env.Environment`."""

SHOWN: Final = (0.1, 0.5, 5.0)
"""Times of `GAP_TIMES` that the page shows [s]."""

_CHANGES: Final = {"start": "start + 1e-6", "timestep": "half timestep"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table: `rows` of one text per column."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """Return the table in Markdown."""
        lines = ["| " + " | ".join(row) + " |" for row in (self.columns, ("---",) * len(self.columns), *self.rows)]
        return "\n".join([f"**{self.title}**", "", *lines]).replace(" *", " \\*")


def tables(measure: str, records: Records) -> list[Table]:
    """Return the tables of one of `MEASURES`; none of no records."""
    make = {"conformance": _conformance, "targets": _targets, "divergence": _divergence, "locomotion": _locomotion,
            "endurance": _endurance, "bench": _bench}[measure]  # fmt: skip
    return make(records) if records else []


def refresh(page: Path, folder: Path) -> str:
    """Return the text of `page` with its parts made anew from the files in `folder`.

    Raises RunError for a page that is missing or lacks the part of a measurement that the folder has.
    """
    if not page.is_file():
        raise RunError(f"{page}: no such page: write one with a part for every measurement, or check the path")
    text = page.read_text(encoding="utf-8")
    for measure in MEASURES:
        file = folder / f"{measure}.json"
        if not file.exists():
            continue
        begin, end = f"<!-- begin {measure} -->", f"<!-- end {measure} -->"
        part = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
        if not part.search(text):
            raise RunError(f"{page}: has no part {begin} ... {end}: add the two lines where its tables belong")
        records = read_records(file)
        body = "\n\n".join([*(table.markdown() for table in tables(measure, records)), *_foot(records)])
        text = part.sub(lambda _, new=f"{begin}\n\n{body}\n\n{end}": new, text)
    return text


def lost_worlds(failures: Mapping[str, int]) -> int:
    """Return how many of the episodes in `failures`, reason -> count, the physics ended."""
    return sum(count for reason, count in failures.items() if not reason.startswith(CROWDED))


def _conformance(records: Records) -> list[Table]:
    def verdict(record: Mapping[str, Any]) -> str:
        if "error" in record:
            return record["error"]
        statuses = [check["status"] for check in record["values"]["checks"]]
        failed, gaps = sum(s in ("failed", "error") for s in statuses), statuses.count("gap")
        parts = [f"{len(statuses) - failed - gaps} hold"]
        return ", ".join(parts + [f"{gaps} gaps"] * bool(gaps) + [f"**{failed} fail**"] * bool(failed))

    gaps: dict[tuple[str, str, str], list[str]] = {}
    told: dict[tuple[str, str], list[str]] = {}
    for record in (record for record in records if "values" in record):
        for check in record["values"]["checks"]:
            if check["status"] != "passed":
                reason = check["reason"] or f"{check['what']}: {check['value']:.2g} > {check['tolerance']:.2g}"
                gaps.setdefault((record["backend"], check["check"].replace("_", " "), reason), []).append(
                    record["robot"]
                )
        for sentence in record["values"]["approximations"]:
            told.setdefault((record["backend"], sentence), []).append(record["robot"])
    made = [_by_backend("Checks of each robot", records, verdict), *_strains(records)]
    if gaps:
        rows = tuple((", ".join(robots), *key) for key, robots in gaps.items())
        made.append(Table(title="What does not hold, and why", columns=("robot", "backend", "check", "why"), rows=rows))
    if told:
        rows = tuple((", ".join(robots), *key) for key, robots in sorted(told.items(), key=lambda i: _order(i[0][0])))
        made.append(Table(title="What an engine only approximates", columns=("robot", "backend", "what"), rows=rows))
    return made


def _strains(records: Records) -> list[Table]:
    """Return how near to its tolerance every check came on each backend, and with which robot; gaps aside."""
    nearest: dict[str, dict[str, tuple[float, str]]] = {}
    robots: dict[str, set[str]] = {}
    for record in (record for record in records if "values" in record):
        for check in record["values"]["checks"]:
            robots.setdefault(check["check"], set()).add(record["robot"])
            if check["status"] == "passed" and check.get("tolerance"):
                of = nearest.setdefault(check["check"], {})
                share = (float(check["value"]) / float(check["tolerance"]), record["robot"])
                of[record["backend"]] = max(share, of.get(record["backend"], share))
    backends = sorted({record["backend"] for record in records}, key=_order)
    rows = []
    for name, of in nearest.items():
        cells = [f"{of[backend][0]:.2g}, {of[backend][1]}" if backend in of else "" for backend in backends]
        rows.append((name.replace("_", " "), str(len(robots[name])), *cells))
    title = "Largest measured value of each check, as a share of its tolerance, and whose"
    return [Table(title=title, columns=("check", "robots", *backends), rows=tuple(rows))] if rows else []


def _targets(records: Records) -> list[Table]:
    values = {(record["robot"], record["backend"]): record.get("values", {}) for record in records}
    backends = sorted({backend for _, backend in values}, key=_order)
    rows = []
    for robot in dict.fromkeys(robot for robot, _ in values):
        for figure in FIGURES[robot]:
            cells = [_figure(figure, values.get((robot, backend), {})) for backend in backends]
            rows.append((robot, f"{figure.name} [{figure.unit}]", f"{figure.guard:g}", *cells, figure.why))
    columns = ("robot", "figure", "GUARD", *backends, "why it differs")
    title = f"GUARD's own figures; a star: more than {NEAR:.0%} from them, beside what they are known to"
    return [Table(title=title, columns=columns, rows=tuple(rows))] + (
        [_refusals(records)] if any("error" in record for record in records) else []
    )


def _figure(figure: Figure, values: Mapping[str, float]) -> str:
    if figure.name not in values:
        return "not yet"
    value = values[figure.name]
    return f"{value:.3g}" + ("" if figure.reproduced(value) else "*")


def _divergence(records: Records) -> list[Table]:
    done = [record for record in records if "values" in record]
    if not done:
        return [_refusals(records)]
    setting = done[0]["settings"]
    pairs = [" – ".join(pair["between"]) for pair in done[0]["values"]["pairs"]]
    own = [f"{item['backend']}, {_CHANGES[item['change']]}" for item in done[0]["values"]["own"]]
    worlds, seconds, millimetres = setting["worlds"], setting["seconds"], 1000 * setting["distance"]
    when = f"Seconds until a link is {millimetres:g} mm away, median of {worlds} worlds over {seconds:g} s"
    how_far = f"Millimetres of the farthest link, median of {worlds} worlds"
    times, gaps = [], []
    for record in done:
        compared = [*record["values"]["pairs"], *record["values"]["own"]]
        times.append((record["robot"], *(_time(item, seconds) for item in compared)))
        of_pairs = compared[: len(pairs)]
        gaps.append((record["robot"], *(_gap(item, t) for item in of_pairs for t in SHOWN)))
    at = [f"{pair}, {t:g} s" for pair in pairs for t in SHOWN]
    made = [
        Table(title=when, columns=("robot", *pairs, *own), rows=tuple(times)),
        Table(title=how_far, columns=("robot", *at), rows=tuple(gaps)),
    ]
    return made + ([_refusals(records)] if len(done) < len(records) else [])


def _locomotion(records: Records) -> list[Table]:
    made = []
    for refine, drive in dict.fromkeys((record["refine"], record["drive"]) for record in records):
        chosen = [r for r in records if (r["refine"], r["drive"]) == (refine, drive) and "values" in r]
        how = {"random": "Random controls", "gait": "Gait"}[drive] + ("" if refine == "1" else f", timestep / {refine}")
        for quantity, name in QUANTITIES.items():
            of = {(r["robot"], r["preset"], r["backend"]): r["values"].get(quantity) for r in chosen}
            columns = sorted({key[1:] for key in of}, key=lambda c: (c[0] != "rigid", _order(c[1])))
            robots = dict.fromkeys(key[0] for key, values in of.items() if values)
            rows = [(robot, *(_mean(of, robot, *column) for column in columns)) for robot in robots]
            heads = tuple(f"{preset}, {backend}" for preset, backend in columns)
            if rows:
                made.append(Table(title=f"{how}: {name}", columns=("robot", *heads), rows=tuple(rows)))
    return made + ([_refusals(records)] if any("error" in record for record in records) else [])


def _endurance(records: Records) -> list[Table]:
    def cell(record: Mapping[str, Any]) -> tuple[str, str]:
        if "error" in record:
            return "refused", record["error"]
        values = record["values"]
        lost = lost_worlds(values["failures"])
        crowded = sum(values["failures"].values()) - lost
        text = f"{lost} in {values['steps']:,} steps" + (f", {crowded} without room for a goal" if crowded else "")
        return text, f"{values['fastest']:.3g}"

    return [
        _by_backend("Worlds lost to divergence of the physics", records, lambda record: cell(record)[0]),
        _by_backend("Fastest link after any step [m/s]", records, lambda record: cell(record)[1]),
    ]


def _bench(records: Records) -> list[Table]:
    def rate(record: Mapping[str, Any]) -> str:
        return record.get("error") or f"{record['values']['env_steps_per_second']:,.0f}"

    def efficiency(record: Mapping[str, Any]) -> str:
        return record.get("error") or f"{record['values']['efficiency']:.2f}"

    return [
        _by_backend("Environment steps per second", records, rate),
        _by_backend("Efficiency", records, efficiency),
    ]


def _by_backend(title: str, records: Records, text: Any) -> Table:
    """Return a table of robots by backends with the `text` of each record."""
    found = {(record["robot"], record["backend"]): text(record) for record in records}
    backends = sorted({backend for _, backend in found}, key=_order)
    rows = tuple(
        (robot, *(found.get((robot, backend), "not yet") for backend in backends))
        for robot in dict.fromkeys(robot for robot, _ in found)
    )
    return Table(title=title, columns=("robot", *backends), rows=rows)


def _refusals(records: Records) -> Table:
    rows = tuple((r["robot"], r.get("backend", "all"), r["error"]) for r in records if "error" in r)
    return Table(title="Refused", columns=("robot", "backend", "reason"), rows=rows)


def _time(item: Mapping[str, Any], seconds: float) -> str:
    median = median_time(item["parted_after"])
    return f"> {seconds:g}" if median is None else f"{median:.2g}"


def _gap(item: Mapping[str, Any], time: float) -> str:
    """Return a gap in millimetres; nothing where the tape was shorter."""
    if str(time) not in item["gap"]:
        return ""
    gap = item["gap"][str(time)]
    return "lost" if gap is None else f"{1000 * gap:.1g}" if gap < 0.001 else f"{1000 * gap:,.3g}"


def _mean(of: Mapping[tuple[str, str, str], Any], robot: str, preset: str, backend: str) -> str:
    """Return mean and interval of a cell; a star where it differs from the first backend's in the same preset."""
    values = of.get((robot, preset, backend))
    if not values:
        return "" if (robot, preset, backend) in of else "not yet"
    estimate = interval(values)
    first = min((key[2] for key in of if key[:2] == (robot, preset)), key=_order)
    star = "*" if backend != first and differs(values, of[robot, preset, first]) else ""
    digits = 3 if estimate.mean < 1 else 2
    return f"{estimate.mean:.{digits}f} ± {estimate.half:.{digits}f}{star}"


def _order(backend: str) -> tuple[int, str]:
    """Return where a backend stands in a table: the order in which GUARD names them, then others by name."""
    known = ("mujoco", "bullet", "sapien")
    return (known.index(backend) if backend in known else len(known), backend)


def _foot(records: Records) -> list[str]:
    """Return a line on where the records come from."""
    engines: dict[str, str] = {}
    for record in records:
        engines |= record["engines"]
    states = [record["manifest"]["git"] or {} for record in records]
    commits = {str(git.get("commit", "?"))[:7] + ("+" if git.get("dirty") else "") for git in states}
    changed = " (+: with changes)" if any(commit.endswith("+") for commit in commits) else ""
    versions = ", ".join(f"{name} {version}" for name, version in sorted(engines.items()))
    return [f"Measured with {versions}, at commits {', '.join(sorted(commits))}{changed}."] if records else []
