"""What the page of a batch shows, in the little space that lets ten thousand logs open at once."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from statistics import median
from typing import Any
from urllib.parse import quote

from attlog.compare.gates.rows import BASELINES
from attlog.fleet.pages.thumbnail import POINTS
from attlog.fleet.records.entry import Entry
from attlog.fleet.records.row import light
from attlog.fleet.records.trouble import trouble, with_gates
from attlog.present.numbers import unit_sign
from attlog.present.text import clean, typeset

LEVELS = ("serious", "look", "failed", "none")
"""What somebody should open first. A log that failed may hide anything, but there is nothing to open."""
KINDS = ("gate", "attitude", "crash", "reset", "filter", "sensor", "log")
MOST_ROWS, MOST_COLUMNS = 16, 10
"""Rows and columns of numbers that the page offers, the most common ones; all stand in the results file."""
LEAST_SHARE = 0.5
"""The attitude that flew is shown first where so many logs have numbers for it."""
NEARLY_ALL = 0.9
NO_VALUE, FULL_BYTE, FULL_DEG = 255, 254, 180.0
AUTO = "onboard"


@dataclass(frozen=True, slots=True)
class Line:
    """One log as the page shows it."""

    name: str
    log: str
    href: str
    level: str
    score: float
    reasons: list[dict[str, Any]]
    message: str
    row: dict[str, Any] | None


def ordered(entries: Iterable[Entry]) -> list[Line]:
    """The logs of a batch, the worst first; equally bad ones by their names."""
    return sorted((line(e) for e in entries), key=lambda x: (LEVELS.index(x.level), -x.score, natural(x.name), x.log))


def natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts log9 before log10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", name.casefold())]


def line(entry: Entry) -> Line:
    """One log: how urgently somebody should look, and the link to its report."""
    said = with_gates(entry.row["trouble"] if entry.row else trouble([]), entry.gates)
    level = said["level"] if entry.row else "failed"
    href = quote(os.fsencode(f"{entry.name}.html")) if entry.row else ""
    row = light(entry.row) if entry.row else None
    return Line(entry.name, entry.log, href, level, said["score"], said["reasons"], failure(entry), row)


def failure(entry: Entry) -> str:
    """Why a log has no report, without its name, which stands beside it."""
    text = entry.message.removeprefix("attlog: ")
    for name in (entry.log, entry.name, re.split(r"[/\\]", entry.log)[-1]):
        text = text.removeprefix(f"{name}: ")
    return text


def page_data(lines: list[Line]) -> tuple[dict[str, Any], bytes]:
    """Columns of values, one for each thing that the page shows, and the thumbnails: POINTS bytes of each curve."""
    flights: list[dict[str, Any]] = [x.row["flight"] if x.row else {} for x in lines]
    names, columns = numbers(lines)
    thumbnails = bytearray()
    data = {
        "name": [clean(x.name) for x in lines],
        "log": [clean(x.log) for x in lines],
        "href": [x.href for x in lines],
        "level": [LEVELS.index(x.level) for x in lines],
        "score": [x.score for x in lines],
        "reasons": [[[KINDS.index(r["kind"]), typeset(r["text"]), _time(r["t"])] for r in x.reasons] for x in lines],
        "message": [typeset(x.message) for x in lines],
        "date": [_epoch(f.get("date_utc")) for f in flights],
        "seconds": [_whole(f.get("duration_s")) for f in flights],
        "air": [_whole(f.get("airborne_s")) for f in flights],
        "reference": _coded([f.get("reference") for f in flights]),
        "firmware": _coded([f.get("firmware") for f in flights]),
        "vehicle": _coded([f.get("vehicle") for f in flights]),
        "board": _coded([f.get("board") for f in flights]),
        "headline": [clean(x.row.get("headline") or "") if x.row else "" for x in lines],
        "says": [[typeset(v["sentence"]) for v in x.row["verdicts"]] if x.row else [] for x in lines],
        "thumb": [_thumbnail(x.row, thumbnails) for x in lines],
        "points": POINTS,
        "kinds": KINDS,
        "levels": LEVELS,
        "rows": names,
        "columns": columns,
        "first": first_row(names, columns, sum(x.row is not None for x in lines)),
    }
    return data, bytes(thumbnails)


def numbers(lines: list[Line]) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """The most common rows with their names, and the columns: title, unit, and row -> a value or None for each log."""
    rows: Counter[str] = Counter()
    titles: Counter[str] = Counter()
    names = {AUTO: AUTO.capitalize()}  # whichever message it comes from
    for x in lines:
        for column in x.row["columns"] if x.row else []:
            held = [name for name, value in column["values"].items() if not isinstance(value, str)]
            rows.update(held)
            titles[column["title"]] += 1
        for key, about in (x.row["rows"] if x.row else {}).items():
            names.setdefault(key, about["name"])
    kept = [name for name, _ in rows.most_common(MOST_ROWS)]
    shown = {title for title, _ in titles.most_common(MOST_COLUMNS)}
    columns: dict[str, dict[str, Any]] = {}
    for i, x in enumerate(lines):
        for column in x.row["columns"] if x.row else []:
            if column["title"] not in shown:
                continue
            about = {k: column[k] for k in ("title", "metric", "unit")} | {
                "sign": unit_sign(column["unit"]),
                "values": {},
            }
            place = columns.setdefault(column["title"], about)["values"]
            for name in kept:
                value = column["values"].get(name)
                if isinstance(value, (int, float)):
                    place.setdefault(name, [None] * len(lines))[i] = float(f"{value:.4g}")
    order = {title: k for k, title in enumerate(_order(lines))}
    found = sorted(columns.values(), key=lambda c: order[c["title"]])
    return {name: clean(names.get(name, name)) for name in sorted(kept, key=_place)}, found


def first_row(names: Iterable[str], columns: list[dict[str, Any]], count: int) -> str:
    """The row whose numbers are shown at first: the attitude that flew, where most logs have an error of it.

    Else, of the rows with nearly the most values, the one that has the smallest middle in the first column.
    """
    known = {row: sum(v is not None for c in columns for v in c["values"].get(row, ())) for row in names}
    errors = columns[0]["values"] if columns else {}
    if sum(v is not None for v in errors.get(AUTO, ())) >= LEAST_SHARE * max(count, 1):
        return AUTO
    filters = {row: n for row, n in known.items() if row not in BASELINES and not row.startswith(AUTO)} or known
    most = max(filters.values(), default=0)
    common = [row for row, n in filters.items() if n >= NEARLY_ALL * most]
    middle = {row: [abs(v) for v in errors.get(row, ()) if v is not None] for row in common}
    return min(common, key=lambda row: median(middle[row]) if middle[row] else math.inf, default="")


def _order(lines: list[Line]) -> list[str]:
    """Titles in the order of the logs that have most of them."""
    longest = sorted((x.row["columns"] for x in lines if x.row), key=len, reverse=True)
    return list(dict.fromkeys(c["title"] for columns in longest for c in columns))


def _place(row: str) -> tuple[int, str]:
    return (0 if row == AUTO else 2 if row.startswith(f"{AUTO}:") else 1, row)


def _coded(values: list[Any]) -> dict[str, Any]:
    """Words as places in a list of them, in natural order; -1 where there is none."""
    words = sorted({clean(v) for v in values if v}, key=natural)
    place = {word: i for i, word in enumerate(words)}
    return {"words": words, "at": [place[clean(v)] if v else -1 for v in values]}


def _thumbnail(row: dict[str, Any] | None, out: bytearray) -> list[Any] | None:
    """What stands beside the curves of a thumbnail; the curves go to ``out``, small angles finer than large ones."""
    seen = row["thumbnail"] if row else None
    if seen is None:
        return None
    at = len(out)
    for curve in ("tilt", "tilt_diff", "heading_diff"):
        out += bytes(NO_VALUE if v is None else round(FULL_BYTE * math.sqrt(v / FULL_DEG)) for v in seen[curve])
    return [at, seen["t0"], seen["t1"], seen["of"], seen["air"], [t for t, _ in seen["marks"]]]


def _epoch(date: str | None) -> int | None:
    """Seconds since 1970 of an ISO date; None for none, and for one that is no date."""
    try:
        found = datetime.fromisoformat(date) if date else None
    except ValueError:
        return None
    return None if found is None else int((found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp())


def _time(t: float | None) -> float | None:
    return None if t is None else round(t, 1)


def _whole(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 1)
