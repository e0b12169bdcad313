"""The page: what the template shows, the packed blocks, the content-security policy."""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from attlog.numbers import duration, listed, number, quantity, unit_sign
from attlog.output import write_atomic
from attlog.report.bundle import Bundle, bundle, source_hash
from attlog.report.figures import sections
from attlog.report.look import Look, looks
from attlog.report.marks import alarming, level_name, messages, time_marks
from attlog.report.pack import Store, packed
from attlog.report.table import axis_table, main_table, window_tables
from attlog.result import Result, Verdict

if TYPE_CHECKING:
    from attlog.flight.model import Problem

HERE = Path(__file__).parent
SCRIPTS = ("unpack.js", "theme.js", "reduce.js", "plots.js", "figures.js", "page.js")
"""Joined in this order into the one script of the page."""

BARS = 7
"""Rows in a verdict card; the table has them all."""

FULL_BAR_MS = 20.0
"""Delays below this do not fill a bar, so that half a millisecond does not look late."""

SEVERITY = {
    "error": ("Serious", "bad"),
    "warning": ("Limits", "warn"),
    "note": ("Note", "note"),
    "info": ("Note", "note"),
}
SECTIONS = {"quiet": "rest", "late": "step", "drifting": "drift"}
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]")


def write_report(result: Result, path: str | Path, *, plotly: str = "inline") -> None:
    """Write the report of a result to ``path`` (atomically). OutputError if it cannot be written.

    ``plotly`` is ``inline`` (one file that loads nothing) or ``shared`` (the bundle
    is written once beside the report and loaded from there, for batches).
    """
    path = Path(path)
    plot = bundle()
    shared = plotly == "shared"
    html = render(result, plot, shared=shared)
    if shared:
        beside = path.parent / plot.name
        if not beside.is_file() or beside.read_bytes() != plot.script:
            write_atomic(beside, plot.script)
    write_atomic(path, html)


def render(result: Result, plot: Bundle, *, shared: bool = False) -> str:
    """The report as text: template, style and script of this package, data packed."""
    from jinja2 import Environment, FileSystemLoader

    look = looks(result)
    store = Store()
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
        "marks": cleaned(time_marks(result)),
        "figures": {
            f.id: {"kind": f.kind, "height": f.height} | cleaned(f.data) for part in figures.values() for f in part
        },
        "shared": {"src": plot.name, "integrity": plot.hash} if shared else None,
    }
    style = (HERE / "style.css").read_text(encoding="utf-8")
    parts = [(HERE / name).read_text(encoding="utf-8") for name in SCRIPTS]
    script = "\n".join(["'use strict';(() => {", *parts, "})();", ""])
    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, finalize=shown, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "unit": unit_sign,
        "duration": duration,
        "quantity": quantity,
        "number": number,
        "value": plain_value,
    }
    document = json.dumps(result.to_dict(), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return environment.get_template("page.html").render(
        result=result,
        policy=policy(plot, style, script, shared=shared),
        style=style,
        script=script,
        look=look,
        title=str(result.log.get("name") or "log"),
        subtitle=subtitle(result),
        cards=[card(v, look) for v in result.verdicts],
        problems=problems(result),
        table=main_table(result),
        axes=axis_table(result),
        windows=window_tables(result),
        figures=figures,
        messages=[(t, level_name(level), alarming(level, text), text) for t, level, text in messages(result)],
        config=json.dumps(result.to_dict()["config"], indent=1, ensure_ascii=False),
        firmware=firmware(result),
        columns=columns,
        data=store.pack(header),
        json=packed(document.encode("utf-8", "replace")),
        bundle=None if shared else packed_once(plot),
        shared=plot.name if shared else None,
        bundle_name=plot.name,
    )


def packed_once(plot: Bundle) -> str:
    """The bundle as it stands compressed in the installation, in base64."""
    return base64.b64encode(plot.packed).decode()


def policy(plot: Bundle, style: str, script: str, *, shared: bool) -> str:
    """The content-security policy: the page's own script, style and bundle by hash, nothing else, no request.

    A shared bundle is loaded by the page's own script, hence ``strict-dynamic``: a hash
    alone does not let a browser load a script from the disk (it cannot enforce
    ``integrity`` there; on a server the page's script asks for it).
    """
    scripts = [plot.hash, source_hash(script.encode("utf-8")), *(["strict-dynamic"] if shared else [])]
    styles = [source_hash(style.encode("utf-8")), *plot.styles]
    quoted = [" ".join(f"'{h}'" for h in hashes) for hashes in (scripts, styles)]
    return (
        f"default-src 'none'; script-src {quoted[0]}; style-src {quoted[1]}; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def columns(entries: list[dict[str, Any]]) -> list[str]:
    """The keys of a list of dictionaries, in the order they first appear."""
    return list(dict.fromkeys(str(key) for entry in entries for key in entry))


def subtitle(result: Result) -> list[str]:
    """What flew, when, how long, with which sensors: the parts of the line below the title."""
    log, reference = result.log, result.reference
    seconds = log.get("seconds") or {}
    parts = [str(log.get("vehicle") or ""), firmware(result)]
    if log.get("simulated"):
        parts.append("simulated")
    parts.append(str(log["date_utc"])[:16].replace("T", " ") + " UTC" if log.get("date_utc") else "date unknown")
    length = duration(log.get("duration_s"))
    phases = (("airborne", "in the air"), ("rest", "at rest"))
    used = [f"{duration(seconds[k])} {words}" for k, words in phases if seconds.get(k)]
    parts.append(f"{length}, of which {listed(used)}" if used else length)
    rates = [
        f"{word} {number(log[key]['rate_hz'], 'Hz')} Hz"
        for key, word in (("imu", "IMU"), ("mag", "magnetometer"), ("attitude", "attitude"))
        if log.get(key)
    ]
    parts.append(", ".join(rates))
    count = sum(r.kind == "replay" for r in result.estimators)
    against = {"truth": "the logged truth", "smoother": "the smoother", "onboard": "the onboard attitude"}
    compared = against.get(reference.choice) if reference else None
    filters = f"{count} filter{'' if count == 1 else 's'} re-run"
    parts.append(f"{filters}, compared with {compared}" if compared else f"{filters}, nothing to compare with")
    return [p for p in parts if p]


def firmware(result: Result) -> str:
    """Name, version and board of the autopilot."""
    said = result.log.get("firmware") or {}
    name = " ".join(str(said[k]) for k in ("name", "version") if said.get(k))
    return f"{name} on {said['board']}" if name and said.get("board") else name


def card(verdict: Verdict, look: dict[str, Look]) -> dict[str, Any]:
    """A verdict as the template shows it: bars relative to the largest, reasons gathered."""
    lead, tail = lead_and_tail(verdict.sentence)
    bars = [b for b in verdict.bars if b[0] in look and math.isfinite(b[1])]
    largest = max((abs(v) for _, v, _ in bars), default=0.0)
    largest = max(largest, FULL_BAR_MS) if verdict.question == "late" else largest
    kept = bars
    if len(bars) > BARS:
        kept = [*bars[: BARS - 2], *[b for b in bars[BARS - 2 : -1] if b[0] == "onboard"], bars[-1]]
    unranked = {name for name, _ in verdict.not_judged}
    reasons: dict[str, list[str]] = {}
    for name, reason in verdict.not_judged:
        reasons.setdefault(reason, []).append(name)
    captions = {
        "quiet": "Noise of the worse of roll and pitch, 1σ",
        "late": "Delay against the reference",
        "drifting": "Drift at rest" if "rest" in verdict.metric else "Drift in the air",
    }
    return {
        "id": verdict.question,
        "title": verdict.title,
        "lead": lead,
        "tail": tail,
        "caption": captions.get(verdict.question, "") if kept else "",
        "bars": [
            {
                "name": name,
                "pale": name in unranked,
                "slot": look[name].slot,
                "width": round(100 * abs(value) / largest, 1) if largest > 0 else 0,
                "text": quantity(value, unit),
            }
            for name, value, unit in kept
        ],
        "left_out": len(bars) - len(kept),
        "reasons": [(listed(names), reason) for reason, names in reasons.items()],
        "figures": SECTIONS.get(verdict.question, "flight"),
    }


def lead_and_tail(sentence: str) -> tuple[str, str]:
    """The part of a verdict that is set in bold, up to the first full stop or semicolon, and the rest."""
    nothing = sentence.startswith(("No ", "Cannot "))
    end = re.search(r"[.;:](?= |$)" if nothing else r"[.;](?= |$)", sentence)
    return (sentence[: end.end()], sentence[end.end() :].strip()) if end else (sentence, "")


def problems(result: Result) -> list[dict[str, Any]]:
    """Problems, the worst first, equal sentences once with their count."""
    order = {name: i for i, name in enumerate(SEVERITY)}
    gathered: dict[tuple[str, str], dict[str, Any]] = {}
    for problem in sorted(result.problems, key=lambda p: order.get(p.severity, 9)):
        label, style = SEVERITY.get(problem.severity, ("Note", "note"))
        entry = gathered.setdefault(
            (problem.severity, problem.text),
            {
                "label": label,
                "style": style,
                "text": problem.text,
                "where": where(problem),
                "t": shown_time(problem),
                "count": 0,
            },
        )
        entry["count"] += problem.count
    return list(gathered.values())


def shown_time(problem: Problem) -> float | None:
    """Seconds of a problem on the log's clock, None where it has no time."""
    return round(problem.t, 3) if problem.t is not None and math.isfinite(problem.t) else None


def where(problem: Problem) -> str:
    """Where in the log: seconds or bytes."""
    if (t := shown_time(problem)) is not None:
        return f"at {t:.1f} s"
    said = problem.offset is None or str(problem.offset) in problem.text
    return "" if said else f"at byte {problem.offset:,}"


def plain_value(value: Any, unit: str = "") -> str:
    """A value of unknown type as text."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        sign = unit_sign(unit)
        text = f"{value:.4g}".replace("-", "\u2212")
        return f"{text}{sign}" if sign.startswith("°") else f"{text} {sign}".rstrip()
    return f"{value} {unit_sign(unit)}".rstrip()


def clean(text: str) -> str:
    """Text from a log made fit to be shown: control and direction characters become a visible mark."""
    return CONTROL.sub("\ufffd", str(text))


def shown(value: Any) -> Any:
    """What the template puts in place of a value: texts cleaned (jinja escapes them), own markup as it is."""
    return value if hasattr(value, "__html__") or not isinstance(value, str) else clean(value)


def cleaned(value: Any) -> Any:
    """The same for every text inside a JSON value; numbers that JSON cannot hold become null."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, dict):
        return {k: cleaned(v) for k, v in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return [cleaned(v) for v in value] if isinstance(value, Iterable) else value
