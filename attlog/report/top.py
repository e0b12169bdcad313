"""What stands at the top of the page: the line below the title, the verdict cards, the problems."""

from __future__ import annotations

import math
import re
from typing import Any

from attlog.present.numbers import MINUS, duration, listed, number, quantity
from attlog.present.verdicts import SITUATIONS
from attlog.report.look import Look
from attlog.result import Problem, Result, Verdict

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
    """A verdict as the template shows it: bars from a common zero, reasons gathered."""
    lead, tail = lead_and_tail(verdict.sentence)
    bars = [b for b in verdict.bars if b[0] in look and math.isfinite(b[1])]
    kept = bars
    if len(bars) > BARS:
        kept = [*bars[: BARS - 2], *[b for b in bars[BARS - 2 : -1] if b[0] == "onboard"], bars[-1]]
    unranked = {name for name, reason in verdict.not_judged if not reason.startswith(SITUATIONS)}
    low, high = span([v for _, v, _ in kept], FULL_BAR_MS if verdict.question == "late" else 0.0)
    captions = {
        "quiet": "Noise (1σ) of roll or pitch, whichever is worse",
        "late": f"Delay against the reference, + late, {MINUS} early",
        "drifting": "Drift at rest" if "rest" in verdict.metric else "Drift in the air",
    }
    pale = "; pale: shown, not ranked" if any(name in unranked for name, _, _ in kept) else ""
    return {
        "id": verdict.question,
        "title": verdict.title,
        "lead": lead,
        "tail": tail,
        "caption": captions.get(verdict.question, "") + pale if kept else "",
        "bars": [
            {
                "name": name,
                "pale": name in unranked,
                "slot": look[name].slot,
                "x": round(100 * (min(value, 0.0) - low) / (high - low), 1),
                "width": round(100 * abs(value) / (high - low), 1),
                "text": quantity(value, unit),
            }
            for name, value, unit in kept
        ],
        "zero": round(-100 * low / (high - low), 1),
        "left_out": len(bars) - len(kept),
        "reasons": reasons(verdict, look),
        "figures": SECTIONS.get(verdict.question, "flight"),
    }


def span(values: list[float], least: float) -> tuple[float, float]:
    """Ends of the scale of a card's bars: zero and all values, ``least`` wide or wider."""
    low, high = min([0.0, *values]), max([0.0, *values])
    return low, max(high, low + least) if high > low or least else 1.0


def reasons(verdict: Verdict, look: dict[str, Look]) -> list[tuple[str, str]]:
    """Who is not judged, and why: rows with the same reason together, what needs no reason left out."""
    gathered: dict[str, list[str]] = {}
    for name, reason in verdict.not_judged:
        if not reason.endswith("itself"):
            gathered.setdefault(reason, []).append(name)
    filters = {name for name, k in look.items() if not k.onboard}
    return [
        ("All filters" if len(names) > 1 and filters <= set(names) else listed(names), reason)
        for reason, names in gathered.items()
    ]


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
