"""The flight in one strip: height, in flight, flight modes, and what happened as marks that lead to the figures.

Places across are percentages of the width, so that the strip fits any screen; heights are in the units of HEIGHT.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from attlog.present.events import LABELS
from attlog.present.numbers import duration, moment
from attlog.report.figures.marks import time_range
from attlog.result import Event, Result

HEIGHT = 60
"""Of the area of the curve, in its own units."""
LEAST_M = 1.0
ROUNDED_M = 2.0
"""From here a height is told in whole metres."""
WIDE_PX, LETTER_PX, GAP_PX = 830.0, 6.6, 8.0
"""Labels are placed for a strip of a screen's width; a phone shows only those of serious events."""
LEVELS = 3
MOST = 40
ROUTINE = ("armed", "liftoff", "landing")
"""Kinds that get a mark though nothing is wrong with them."""
GRADES = {"serious": 2, "warning": 1}


@dataclass(slots=True)
class Mark:
    """An event at ``x`` %: its style, sentence, label with its level from the top; ``left``: it stands left of it."""

    t: float
    x: float
    style: str
    text: str
    label: str = ""
    level: int = 0
    left: bool = False


@dataclass(slots=True)
class Strip:
    """What is drawn; ``curve`` is the path of the height, empty where unknown; ``modes`` and ``air`` are spans."""

    curve: str
    top: str
    start: str
    end: str
    peak: float = 50.0
    air: list[tuple[float, float]] = field(default_factory=list)
    modes: list[tuple[float, float, str]] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)
    words: str = ""


def strip(result: Result) -> Strip:
    """The strip of a result."""
    start, end = time_range(result)
    line = result.log.get("timeline") or {}

    def place(t: float) -> float:
        return round(min(max(100.0 * (t - start) / (end - start), 0.0), 100.0), 2)

    air = [(place(a), place(b)) for a, b in line.get("airborne") or []]
    modes = [(place(a), place(b), fitting(str(name), place(b) - place(a))) for a, b, name in line.get("modes") or []]
    curve, top, highest = height(result, start, end)
    peak = min(max(place(highest), 3.0), 97.0)
    marks = [Mark(e.t, place(e.t), style(e), e.text, LABELS.get(e.kind, "")) for e in chosen(result.events)]
    labelled(marks, peak if top else None)
    words = f"{duration(end - start)} of log" + (f", up to {top}" if top else "")
    return Strip(curve, top, moment(start, 0), moment(end, 0), peak, air, modes, marks, words)


def height(result: Result, start: float, end: float) -> tuple[str, str, float]:
    """The path of the height, its largest in flight as text, and when that was; texts are empty where unknown.

    A barometer that never flew shows the weather. The text is that of the headline: rounded alike, and none where the
    log shows no ground.
    """
    trace = next((t for t in result.traces if t.figure == "height"), None)
    flights = (result.log.get("timeline") or {}).get("airborne") or []
    if trace is None or not flights or not np.isfinite(trace.columns["height"]).any():
        return "", "", start
    t, y = np.asarray(trace.t, np.float64), np.asarray(trace.columns["height"], np.float64)
    flying = np.zeros(len(t), bool)
    for a, b in flights:
        flying |= (t >= a) & (t <= b)
    most = float(np.nanmax(np.where(flying, y, -math.inf))) if (flying & np.isfinite(y)).any() else math.nan
    top = max(most if math.isfinite(most) else float(np.nanmax(y)), LEAST_M)
    x = np.clip(1000.0 * (t - start) / (end - start), 0.0, 1000.0)
    down = HEIGHT * (1.0 - np.clip(np.nan_to_num(y) / top, 0.0, 1.0))
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, down, strict=True))
    told = trace.values.get("top")
    text = "" if told is None else f"{told:.0f} m" if told >= ROUNDED_M else f"{told:.1f} m"
    highest = float(t[np.nanargmax(np.where(flying, y, np.nan))]) if text and math.isfinite(most) else start
    return f"M{x[0]:.1f},{HEIGHT} L{points} {x[-1]:.1f},{HEIGHT}Z", text, highest


def chosen(events: list[Event]) -> list[Event]:
    """What gets a mark: what is serious or a warning, and the routine of a flight; the worst where they are many."""
    shown = [e for e in events if e.severity in GRADES or e.kind in ROUTINE]
    worst = sorted(shown, key=lambda e: -GRADES.get(e.severity, 0))[:MOST]
    return sorted(worst, key=lambda e: e.t)


def style(event: Event) -> str:
    """How a mark is drawn."""
    return {"serious": "bad", "warning": "warn"}.get(event.severity, "")


def labelled(marks: list[Mark], peak: float | None = None) -> list[Mark]:
    """Labels where they collide with none that matters more; a mark without room keeps its sentence only.

    ``peak`` %: there the second level holds how high it went.
    """
    taken: list[list[tuple[float, float]]] = [[] for _ in range(LEVELS)]
    if peak is not None:
        taken[1].append((peak * WIDE_PX / 100.0 - 20.0, peak * WIDE_PX / 100.0 + 20.0))
    order = sorted(marks, key=lambda m: (-{"bad": 2, "warn": 1}.get(m.style, 0), m.t))
    said: set[tuple[str, str]] = set()
    for mark in order:
        wide, at = LETTER_PX * len(mark.label) + GAP_PX, mark.x * WIDE_PX / 100.0
        places = [(level, left) for left in (False, True) for level in range(LEVELS)]
        room = next((p for p in places if free(taken[p[0]], *reach(at, wide, p[1]))), None)
        if room is None or not mark.label or ((mark.label, mark.style) in said and mark.style != "bad"):
            mark.label = ""
            continue
        said.add((mark.label, mark.style))
        mark.level, mark.left = room
        taken[mark.level].append(reach(at, wide, mark.left))
    return marks


def reach(at: float, wide: float, left: bool) -> tuple[float, float]:
    """Where a label begins and ends, px."""
    return (at - wide, at) if left else (at, at + wide)


def free(taken: list[tuple[float, float]], a: float, b: float) -> bool:
    """Whether nothing stands between a and b, which lie in the strip."""
    return a >= 0.0 and b <= WIDE_PX and all(b <= low or a >= high for low, high in taken)


def fitting(name: str, share: float) -> str:
    """The name of a mode where its part of the strip has room for it."""
    return name if LETTER_PX * len(name) + GAP_PX <= share * WIDE_PX / 100.0 else ""
