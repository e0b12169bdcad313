"""``index.html`` of a batch: one file in which ten thousand logs can be sorted and filtered, the worst first."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from attlog.batch.across import AGAINST_REFERENCE
from attlog.batch.index_row import THUMBNAIL_POINTS, Entry, encoded, sensors_of
from attlog.batch.order import FIRST, LEVELS, TITLES, RankedLog, natural, ordered, short_names
from attlog.compare.gates import BASELINE_ESTIMATORS
from attlog.core.files import write_atomic
from attlog.report.bundle import packed, source_hash
from attlog.report.shell import WEB as REPORT
from attlog.words.numbers import counted, listed, unit_sign
from attlog.words.text import clean, cleaned, typeset

WEB = Path(__file__).parent / "web"
SCRIPTS = (REPORT / "unpack.js", REPORT / "theme.js", WEB / "words.js", WEB / "charts.js", WEB / "index.js")
"""Joined in this order into the one script of the page."""
WITHOUT_SCRIPT = 100
"""Logs that are listed for a browser without JavaScript."""
INDEX = "index.html"
KINDS = ("gate", "attitude", "crash", "reset", "filter", "sensor", "log")
MOST_ROWS, MOST_COLUMNS = 16, 10
"""Rows and columns of numbers that the page offers, the most common ones; all stand in the results file."""
AUTO = "onboard"
JUDGES = ("truth", "smoother")
"""References that may judge an onboard attitude; what else is compared with shows agreement, not error."""


def write_index(folder: Path, entries: Iterable[Entry], *, title: str = "", results: str = "") -> Path:
    """Write ``index.html`` to the folder in which the reports are. OutputError if it cannot be written.

    Equal entries give equal bytes, in any order. ``title``: what the batch is called, the folder's name by default;
    ``results``: the name of the file with all numbers, if there is one.
    """
    path = folder / INDEX
    write_atomic(path, render(entries, title=title or folder.resolve().name, results=results))
    return path


def render(entries: Iterable[Entry], *, title: str = "", results: str = "") -> str:
    """The page as text: template, style and script of this package, data packed."""
    from attlog.report.templates import template

    lines = ordered(entries)
    data, thumbnails = page_data(lines)
    style = "\n".join((file).read_text(encoding="utf-8") for file in (REPORT / "style.css", WEB / "index.css"))
    parts = [file.read_text(encoding="utf-8") for file in SCRIPTS]
    script = "\n".join(["'use strict';(() => {", *parts, "})();", ""])
    return template("index.html", {"typeset": typeset, "counted": counted}, WEB).render(
        policy=policy(style, script),
        style=style,
        script=script,
        title=clean(title),
        subtitle=subtitle(lines),
        worst=[x for x in lines if x.level not in ("unjudged", "none")][:WITHOUT_SCRIPT],
        count=len(lines),
        data=block(data, thumbnails),
        results=results,
        versions=listed(sorted({str(x.row["flight"]["attlog"]) for x in lines if x.row})),
    )


def subtitle(lines: list[RankedLog]) -> list[str]:
    """What flew, from when to when, how long; how many logs there are stands in a tile."""
    flights = [x.row["flight"] for x in lines if x.row]
    vehicles = Counter(clean(f["vehicle"]) for f in flights if f["vehicle"])
    dates = sorted(str(f["date_utc"])[:10] for f in flights if f["date_utc"])
    hours = sum(f["airborne_s"] or 0.0 for f in flights) / 3600.0
    kinds = listed([counted(n, name) for name, n in vehicles.most_common(4)])
    parts = [kinds + (" and others" if len(vehicles) > 4 else "")]
    parts.append(clean(dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}") if dates else "")
    parts.append(f"{hours:.1f} h in the air" if hours >= 1.0 else f"{60.0 * hours:.0f} min in the air")
    return [p for p in parts if p]


def block(data: dict[str, Any], thumbnails: bytes) -> str:
    """Header and bytes as the page's script unpacks them: the header's length, header, bytes; gzipped, base64."""
    text = json.dumps(cleaned(data), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode("utf-8")
    return packed(len(text).to_bytes(4, "little") + text + thumbnails)


def policy(style: str, script: str) -> str:
    """The content-security policy: the page's own script and style by hash, nothing else, no request."""
    script_hash, style_hash = (source_hash(part.encode("utf-8")) for part in (script, style))
    return (
        f"default-src 'none'; script-src '{script_hash}'; style-src '{style_hash}'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def page_data(lines: list[RankedLog]) -> tuple[dict[str, Any], bytes]:
    """Columns of values, one for each thing that the page shows, and the thumbnails: POINTS bytes each."""
    flights: list[dict[str, Any]] = [x.row["flight"] if x.row else {} for x in lines]
    sensors = [sensors_of(x.row or {}) for x in lines]
    names, columns = numbers(lines)
    thumbnails = bytearray()
    data = {
        "name": [clean(x.name) for x in lines],
        "short": short_names([clean(x.name) for x in lines]),
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
        "text": [clean(x.text) for x in lines],
        "sensors": [[s["faults"], s["warnings"], [clean(text) for text in s["to_set"]]] for s in sensors],
        "says": [[typeset(v["sentence"]) for v in x.row["verdicts"]] if x.row else [] for x in lines],
        "thumb": [encoded(x.row["thumbnail"] if x.row else None, thumbnails) for x in lines],
        "points": THUMBNAIL_POINTS,
        "top": sum(x.opens_first for x in lines[:FIRST]),
        "kinds": KINDS,
        "levels": TITLES,
        "rows": names,
        "columns": columns,
        "first": first_row(names, columns),
    }
    return data, bytes(thumbnails)


def numbers(lines: list[RankedLog]) -> tuple[dict[str, str], list[dict[str, Any]]]:
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
                if isinstance(value, (int, float)) and _judged(name, column["metric"], x):
                    place.setdefault(name, [None] * len(lines))[i] = float(f"{value:.4g}")
    order = {title: k for k, title in enumerate(_order(lines))}
    found = sorted(columns.values(), key=lambda c: order[c["title"]])
    return {name: clean(names.get(name, name)) for name in sorted(kept, key=_place)}, found


def first_row(names: Iterable[str], columns: list[dict[str, Any]]) -> str:
    """The row whose numbers are shown at first: the onboard attitude, else the filter with most numbers."""
    known = Counter({row: sum(v is not None for c in columns for v in c["values"].get(row, ())) for row in names})
    filters = [row for row in known if row not in BASELINE_ESTIMATORS and not row.startswith(AUTO)]
    return AUTO if known[AUTO] else max(filters or known, key=lambda row: known[row], default="")


def _judged(row: str, metric: str, log: RankedLog) -> bool:
    """Whether a value may be shown: what says how far onboard attitudes err needs a reference that may judge them."""
    error_of_onboard = row.startswith(AUTO) and metric.startswith(AGAINST_REFERENCE)
    return not error_of_onboard or (log.row or {"flight": {}})["flight"].get("reference") in JUDGES


def _order(lines: list[RankedLog]) -> list[str]:
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
