"""The verdict cards: bars from a common zero, their scale set by the rows that are ranked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import median
from typing import Any

from attlog.present.cards import caption, lead_and_tail, not_ranked, reasons
from attlog.present.numbers import quantity
from attlog.report.look import Look
from attlog.result import Verdict

BARS = 7
"""Rows in a verdict card; the table has them all."""

FAR = 4.0
"""A row that is not ranked and this many times the middle one runs out of its card."""

FULL_BAR_MS = 20.0
"""Lags below this do not fill a bar, so that half a millisecond does not look like much."""

SECTIONS = {"accuracy": "flight", "noise": "rest", "lag": "step", "yaw_drift": "drift"}


def card(verdict: Verdict, look: Mapping[str, Look]) -> dict[str, Any]:
    """A verdict as the template shows it."""
    lead, tail = lead_and_tail(verdict.sentence)
    bars = [b for b in verdict.bars if b[0] in look and math.isfinite(b[1])]
    kept = bars
    if len(bars) > BARS:
        kept = [*bars[: BARS - 2], *[b for b in bars[BARS - 2 : -1] if b[0] == "onboard"], bars[-1]]
    unranked = not_ranked(verdict)
    middle = median(abs(v) for _, v, _ in kept) if kept else 0.0
    ranked = {name for name, _, _ in kept if name not in unranked and not look[name].lost}
    low, high = span(
        [v for name, v, _ in kept if name in ranked or abs(v) <= FAR * middle],
        FULL_BAR_MS if verdict.question == "lag" else 0.0,
    )
    pale = "; pale: not ranked" if any(name in unranked for name, _, _ in kept) else ""
    return {
        "id": verdict.question,
        "title": verdict.title,
        "lead": lead,
        "tail": tail,
        "caption": caption(verdict) + pale if kept else "",
        "bars": [
            {
                "id": name,
                "name": look[name].name,
                "pale": name in unranked,
                "slot": look[name].slot,
                "x": round(100 * (min(shown, 0.0) - low) / (high - low), 1),
                "width": round(100 * abs(shown) / (high - low), 1),
                "beyond": "" if shown == value else "◂ " if value < 0 else "▸ ",
                "text": quantity(value, unit),
            }
            for name, value, unit in kept
            for shown in [min(max(value, low), high)]
        ],
        "zero": round(-100 * low / (high - low), 1),
        "left_out": len(bars) - len(kept),
        "reasons": reasons(
            verdict, {k: v.name for k, v in look.items()}, {k for k, v in look.items() if not v.onboard}
        ),
        "notes": verdict.notes,
        "figures": SECTIONS.get(verdict.question, "flight"),
    }


def span(values: list[float], least: float) -> tuple[float, float]:
    """Ends of the scale of a card's bars: zero and all values, ``least`` wide or wider."""
    low, high = min([0.0, *values]), max([0.0, *values])
    return low, max(high, low + least) if high > low or least else 1.0
