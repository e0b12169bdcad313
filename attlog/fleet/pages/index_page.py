"""``index.html`` of a batch: one file in which ten thousand logs can be sorted and filtered, the worst first."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from attlog.base.files.output import write_atomic
from attlog.fleet.pages.index_data import Line, ordered, page_data
from attlog.fleet.records.entry import Entry
from attlog.present.numbers import counted, listed
from attlog.present.text import clean, cleaned, typeset
from attlog.report.bundle import source_hash
from attlog.report.pack import packed
from attlog.report.page import WEB as REPORT

WEB = Path(__file__).parents[1] / "web"
SCRIPTS = (REPORT / "unpack.js", REPORT / "theme.js", WEB / "words.js", WEB / "charts.js", WEB / "index.js")
"""Joined in this order into the one script of the page."""
WITHOUT_SCRIPT = 100
"""Logs that are listed for a browser without JavaScript."""
INDEX = "index.html"


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
        worst=[x for x in lines if x.level != "none"][:WITHOUT_SCRIPT],
        count=len(lines),
        data=block(data, thumbnails),
        results=results,
        versions=listed(sorted({str(x.row["flight"]["attlog"]) for x in lines if x.row})),
    )


def subtitle(lines: list[Line]) -> list[str]:
    """How many logs, of what, from when to when, how long they flew."""
    flights = [x.row["flight"] for x in lines if x.row]
    vehicles = Counter(clean(f["vehicle"]) for f in flights if f["vehicle"])
    dates = sorted(str(f["date_utc"])[:10] for f in flights if f["date_utc"])
    hours = sum(f["airborne_s"] or 0.0 for f in flights) / 3600.0
    kinds = listed([counted(n, name) for name, n in vehicles.most_common(4)])
    parts = [counted(len(lines), "log"), kinds + (" and others" if len(vehicles) > 4 else "")]
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
