"""The page: template, style and script put together, data packed, content-security policy."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from attlog.core.files import write_atomic
from attlog.report.bundle import ArrayPacker, Bundle, bundle, packed, source_hash
from attlog.report.figures.catalogue import sections
from attlog.report.figures.panels import time_marks
from attlog.report.figures.style import row_styles
from attlog.report.first_screen import STRIP_HEIGHT, compare_filters, flight_strip
from attlog.result import MEASURED_TIMES, Result
from attlog.words.findings import (
    checks_by_trouble,
    findings,
    parameter_file,
    question_titles,
    reasons_unknown,
    repeat_advice_once,
    shown_assessments,
)
from attlog.words.flight import (
    alarming,
    firmware,
    flight_tone,
    gyro_bias_text,
    level_name,
    messages,
    shown_events,
    subtitle,
    what_happened,
)
from attlog.words.names import duplicate_rows_text
from attlog.words.numbers import counted, duration, moment, number, quantity, unit_sign
from attlog.words.table import axis_table, main_table, window_tables
from attlog.words.text import clean, cleaned, plain_value, typeset

WEB = Path(__file__).parent / "web"
SCRIPTS = (
    "unpack.js",
    "theme.js",
    "reduce.js",
    "plots.js",
    "figures.js",
    "sensors.js",
    "spreadsheet.js",
    "export.js",
    "page.js",
)
"""Joined in this order into the one script of the page."""
FILTERS: dict[str, Callable[..., Any]] = {
    "unit": unit_sign,
    "duration": duration,
    "quantity": quantity,
    "number": number,
    "value": plain_value,
    "typeset": typeset,
    "moment": moment,
    "counted": counted,
    "said_once": repeat_advice_once,
    "titles": question_titles,
    "reasons": reasons_unknown,
}
"""What its template calls."""


def write_report(
    result: Result, path: str | Path, *, deterministic: bool = False, document: dict[str, Any] | None = None
) -> None:
    """Write the report of a result to ``path`` (atomically). OutputError if it cannot be written.

    ``deterministic`` leaves measured times out: the same log gives the same bytes. ``document``: what ``to_dict`` gave
    for it, where somebody has it already.
    """
    path = Path(path)
    write_atomic(path, render(result, bundle(), deterministic=deterministic, document=document))


def render(result: Result, plot: Bundle, *, deterministic: bool = False, document: dict[str, Any] | None = None) -> str:
    """The report as text: template, style and script of this package, data packed."""
    from attlog.report.templates import template

    whole = result.to_dict(deterministic) if document is None else document
    result = timeless(result) if deterministic else result
    look = row_styles(result)
    store = ArrayPacker()
    figures = sections(result, look, store)
    header = {
        "rows": [
            {
                "name": clean(v.name),
                "slot": v.slot,
                "dash": v.dash,
                "shown": v.shown,
                "onboard": v.onboard,
                "lost": v.lost,
            }
            for v in look.values()
        ],
        "log": file_stem(result),
        "marks": cleaned(time_marks(result)),
        "figures": {
            f.id: {"kind": f.kind, "height": f.height} | cleaned(f.data) for part in figures.values() for f in part
        },
    }
    style = (WEB / "style.css").read_text(encoding="utf-8")
    parts = [(WEB / name).read_text(encoding="utf-8") for name in SCRIPTS]
    script = "\n".join(["'use strict';(() => {", *parts, "})();", ""])
    text = json.dumps(whole, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return template("page.html", FILTERS).render(
        result=result,
        policy=policy(plot, style, script),
        style=style,
        script=script,
        look=look,
        title=str(result.log.get("name") or "log"),
        subtitle=subtitle(result),
        headline=what_happened(result),
        tone=flight_tone(result),
        strip=flight_strip(result),
        strip_height=STRIP_HEIGHT,
        happened=shown_events(result),
        four=compare_filters(result, look),
        checked=sum(check.verdict == "ok" for check in result.audit),
        notes={v.question: v.notes for v in result.verdicts},
        findings=findings(result),
        gyro_bias=gyro_bias_text(result),
        alike=duplicate_rows_text(result),
        numbers=main_table(result),
        axes=axis_table(result),
        windows=window_tables(result),
        figures=figures,
        health=shown_assessments(result.health),
        checks=checks_by_trouble(result.audit),
        param_file=parameter_file(result),
        file_stem=file_stem(result),
        messages=[(t, level_name(level), alarming(level, text), text) for t, level, text in messages(result)],
        config=toml(result.config),
        firmware=firmware(result),
        definitions={m: d for m, d in result.definitions.items() if not (deterministic and m in MEASURED_TIMES)},
        data=store.pack(header),
        json=packed(text.encode("utf-8", "replace")),
        bundle=base64.b64encode(plot.packed).decode(),
        bundle_name=plot.name,
    )


def file_stem(result: Result) -> str:
    """The log's name without its suffix, in letters that every file system takes: how saved files begin."""
    stem = Path(str(result.log.get("name") or "")).stem
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", stem)[:80].strip("._-") or "attlog"


def timeless(result: Result) -> Result:
    """The result without what differs between two runs of the same log with the same settings."""

    def left(found: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in found.items() if name not in MEASURED_TIMES}

    def by_window(found: dict[str, Any]) -> dict[str, Any]:
        return {window: left(columns) for window, columns in found.items()}

    rows = [replace(row, ns_per_update=None, metrics=by_window(row.metrics)) for row in result.estimators]
    return replace(
        result,
        command="",
        timing={},
        estimators=rows,
        best=by_window(result.best),
        worst=by_window(result.worst),
        ranked=by_window(result.ranked),
    )


def policy(plot: Bundle, style: str, script: str) -> str:
    """The content-security policy: the page's own script, style and bundle by hash, nothing else, no request."""
    scripts = [plot.hash, source_hash(script.encode("utf-8"))]
    styles = [source_hash(style.encode("utf-8")), *plot.styles]
    quoted = [" ".join(f"'{h}'" for h in hashes) for hashes in (scripts, styles)]
    return (
        f"default-src 'none'; script-src {quoted[0]}; style-src {quoted[1]}; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def toml(config: dict[str, Any]) -> str:
    """The resolved configuration as a file that ``--config`` reads; what is not set is left out."""
    import tomli_w

    return tomli_w.dumps(without_none(config))


def without_none(value: Any) -> Any:
    """A value without the None that TOML cannot hold."""
    if isinstance(value, dict):
        return {str(k): without_none(v) for k, v in value.items() if v is not None}
    return [without_none(v) for v in value if v is not None] if isinstance(value, (list, tuple)) else value
