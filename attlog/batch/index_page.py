"""``index.html`` of a batch: sort and filter ten thousand logs, most urgent first."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from attlog.batch.across import AGAINST_REFERENCE
from attlog.batch.index_row import THUMBNAIL_POINTS, encode_thumbnail, sensors_of
from attlog.batch.job import Record
from attlog.batch.order import LEVELS, OPEN_FIRST, TITLES, IndexRow, index_rows, natural_sort_key, short_names
from attlog.compare.gates import BASELINE_ESTIMATORS
from attlog.core.files import write_atomic
from attlog.core.own_files import INDEX as INDEX_PAGE
from attlog.report.bundle import packed, source_hash
from attlog.report.shell import WEB as REPORT
from attlog.words.numbers import counted, listed, unit_sign
from attlog.words.text import clean, cleaned, typeset

WEB = Path(__file__).parent / "web"
# Scripts of the page, joined in this order.
SCRIPTS = (REPORT / "unpack.js", REPORT / "theme.js", WEB / "words.js", WEB / "charts.js", WEB / "index.js")
# Logs listed for a browser without JavaScript.
MAX_PLAIN = 100
INDEX = "index.html"
KINDS = ("gate", "attitude", "crash", "reset", "filter", "sensor", "log")
# Rows and columns of numbers on the page, the most common ones. The results file has all.
MAX_ROWS, MAX_COLUMNS = 16, 10
ONBOARD = "onboard"
# References independent of the onboard attitude. Against others its difference is agreement, not error.
INDEPENDENT = ("truth", "smoother")


def write_index(folder: Path, found: Iterable[Record], *, title: str = "", results: str = "") -> Path:
    """Write ``index.html`` to the folder of the reports. OutputError if it cannot be written.

    Equal records give equal bytes, in any order. ``title``: the folder's name by default; ``results``: name of the file
    with all numbers, if there is one.
    """
    path = folder / INDEX
    write_atomic(path, render(found, title=title or folder.resolve().name, results=results), INDEX_PAGE)
    return path


def render(found: Iterable[Record], *, title: str = "", results: str = "") -> str:
    """Return the page: template, style, script and packed data."""
    from attlog.report.shell import load_template

    lines = index_rows(found)
    data, thumbnails = page_data(lines)
    style = "\n".join((file).read_text(encoding="utf-8") for file in (REPORT / "style.css", WEB / "index.css"))
    parts = [file.read_text(encoding="utf-8") for file in SCRIPTS]
    script = "\n".join(["'use strict';(() => {", *parts, "})();", ""])
    return load_template("index.html", {"typeset": typeset, "counted": counted}, WEB).render(
        policy=policy(style, script),
        style=style,
        script=script,
        title=clean(title),
        subtitle=subtitle(lines),
        worst=[x for x in lines if x.level not in ("unjudged", "none")][:MAX_PLAIN],
        count=len(lines),
        data=block(data, thumbnails),
        results=results,
        versions=listed(sorted({str(x.row["flight"]["attlog"]) for x in lines if x.row})),
    )


def subtitle(lines: list[IndexRow]) -> list[str]:
    """Return vehicles, dates and time in the air."""
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
    """Pack JSON header, its length and the thumbnail bytes as gzip in base64."""
    text = json.dumps(cleaned(data), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode("utf-8")
    return packed(len(text).to_bytes(4, "little") + text + thumbnails)


def policy(style: str, script: str) -> str:
    """Return a content-security policy: own script and style by hash, no request."""
    script_hash, style_hash = (source_hash(part.encode("utf-8")) for part in (script, style))
    return (
        f"default-src 'none'; script-src '{script_hash}'; style-src '{style_hash}'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def page_data(lines: list[IndexRow]) -> tuple[dict[str, Any], bytes]:
    """Return the columns of the page, and the curves of thumbnails."""
    flights: list[dict[str, Any]] = [x.flight for x in lines]
    sensors = [sensors_of(x.row) for x in lines]
    names, columns = numbers(lines)
    thumbnails = bytearray()
    data = {
        "name": [clean(x.name) for x in lines],
        "short": short_names([clean(x.name) for x in lines]),
        "log": [clean(x.record.log) for x in lines],
        "href": [x.href for x in lines],
        "level": [LEVELS.index(x.level) for x in lines],
        "score": [x.score for x in lines],
        "reasons": [[[KINDS.index(r.kind), typeset(r.text), _rounded(r.t)] for r in x.reasons] for x in lines],
        "message": [typeset(x.message) for x in lines],
        "date": [_epoch(f.get("date_utc")) for f in flights],
        "seconds": [_rounded(f.get("duration_s")) for f in flights],
        "air": [_rounded(f.get("airborne_s")) for f in flights],
        "reference": _coded([f.get("reference") for f in flights]),
        "firmware": _coded([f.get("firmware") for f in flights]),
        "vehicle": _coded([f.get("vehicle") for f in flights]),
        "board": _coded([f.get("board") for f in flights]),
        "text": [clean(x.text) for x in lines],
        "sensors": [[s["faults"], s["warnings"], [clean(text) for text in s["to_set"]]] for s in sensors],
        "says": [[typeset(v["sentence"]) for v in x.row.get("verdicts", [])] for x in lines],
        "thumb": [encode_thumbnail(x.row.get("thumbnail"), thumbnails) for x in lines],
        "points": THUMBNAIL_POINTS,
        "top": sum(x.opens_first for x in lines[:OPEN_FIRST]),
        "kinds": KINDS,
        "levels": TITLES,
        "rows": names,
        "columns": columns,
        "first": first_row(names, columns),
    }
    return data, bytes(thumbnails)


def numbers(lines: list[IndexRow]) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """Return the names of the most common rows, and the columns of numbers.

    A column has a title, a unit, and for each row one value or None per log.
    """
    rows: Counter[str] = Counter()
    titles: Counter[str] = Counter()
    names = {ONBOARD: ONBOARD.capitalize()}  # one name, whichever log message it comes from
    for x in lines:
        for column in x.row.get("columns", []):
            held = [name for name, value in column["values"].items() if not isinstance(value, str)]
            rows.update(held)
            titles[column["title"]] += 1
        for key, about in x.row.get("rows", {}).items():
            names.setdefault(key, about["name"])
    kept = [name for name, _ in rows.most_common(MAX_ROWS)]
    shown = {title for title, _ in titles.most_common(MAX_COLUMNS)}
    columns: dict[str, dict[str, Any]] = {}
    for i, x in enumerate(lines):
        for column in x.row.get("columns", []):
            if column["title"] not in shown:
                continue
            about = {k: column.get(k) for k in ("title", "metric", "agreement", "unit")} | {
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
    """Return the row shown first: onboard attitude, else the filter with most numbers."""
    known = Counter({row: sum(v is not None for c in columns for v in c["values"].get(row, ())) for row in names})
    filters = [row for row in known if row not in BASELINE_ESTIMATORS and not row.startswith(ONBOARD)]
    return ONBOARD if known[ONBOARD] else max(filters or known, key=lambda row: known[row], default="")


def _judged(row: str, metric: str, log: IndexRow) -> bool:
    """Exclude errors of an onboard attitude against a reference that is not independent."""
    error_of_onboard = row.startswith(ONBOARD) and metric.startswith(AGAINST_REFERENCE)
    return not error_of_onboard or log.flight.get("reference") in INDEPENDENT


def _order(lines: list[IndexRow]) -> list[str]:
    """Return column titles, in the order of the logs with most columns."""
    longest = sorted((x.row["columns"] for x in lines if x.row), key=len, reverse=True)
    return list(dict.fromkeys(c["title"] for columns in longest for c in columns))


def _place(row: str) -> tuple[int, str]:
    return (0 if row == ONBOARD else 2 if row.startswith(f"{ONBOARD}:") else 1, row)


def _coded(values: list[Any]) -> dict[str, Any]:
    """Encode texts as indices into a sorted list, -1 for empty."""
    words = sorted({clean(v) for v in values if v}, key=natural_sort_key)
    place = {word: i for i, word in enumerate(words)}
    return {"words": words, "at": [place[clean(v)] if v else -1 for v in values]}


def _epoch(date: str | None) -> int | None:
    """Return the seconds since 1970 of an ISO date, else None."""
    try:
        found = datetime.fromisoformat(date) if date else None
    except ValueError:
        return None
    return None if found is None else int((found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp())


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 1)
