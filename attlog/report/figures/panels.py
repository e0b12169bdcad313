"""What stands on the time axis: phases, modes, messages, failsafes, resets, gaps, impact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.figures.canvas import Canvas, Key, as_array, text_width
from attlog.report.figures.style import DASH, DOT, INK, axis, below, palette
from attlog.result import Result
from attlog.words.flight import WARNING, alarming, messages

MAX_MESSAGES = 2000
"""Messages drawn on the time axis; the worst are kept, the list in the page says how many there are."""

AFTER_CRASH_S = 5.0
"""What figures show after a crash, s, until all of the time is asked for."""


def time_marks(result: Result) -> dict[str, Any]:
    """Everything to draw on the time axes: spans as [[t0, t1, why]], instants as [[t, why]], modes and texts."""
    line = result.log.get("timeline") or {}
    return {
        "range": time_range(result),
        "first": [time_range(result)[0], min(time_range(result)[1], crash_time(result) + AFTER_CRASH_S)],
        "crash": crash_time(result) if crash_time(result) < time_range(result)[1] else None,
        "modes": [[float(a), float(b), str(name)] for a, b, name in line.get("modes") or []],
        "armed": [[float(a), float(b)] for a, b in line.get("armed") or []],
        "airborne": [[float(a), float(b)] for a, b in line.get("airborne") or []],
        "rest": segment_spans(result, "rest"),
        "gaps": segment_spans(result, "gap"),
        "resets": attitude_jumps(result),
        "impact": segment_spans(result, "impact"),
        "texts": marked_messages(messages(result)),
    }


def segment_spans(result: Result, kind: str) -> list[list[Any]]:
    """Segments of a kind (``rest``: long and short) as [t0, t1, why]."""
    return [[s.t0, s.t1, s.why] for s in result.segments if s.kind.partition(".")[0] == kind]


def attitude_jumps(result: Result) -> list[list[Any]]:
    """Jumps of the onboard attitude as the list of events has them, [t, text]."""
    return [[e.t, e.text] for e in result.events if e.kind == "reset"]


def time_range(result: Result) -> list[float]:
    """First and last second that any figure shows."""
    times = [float(x) for t in result.traces if t.figure == "attitude" and len(t.t) for x in (t.t[0], t.t[-1])]
    end = max([*times, float(result.log.get("duration_s") or 0.0), 1e-3])
    return [min([*times, 0.0]), end]


def crash_time(result: Result) -> float:
    """When the last flight ended in a crash, s; infinite where it did not."""
    flights = [float(a) for a, _ in (result.log.get("timeline") or {}).get("airborne") or []]
    last = max(flights, default=-math.inf)
    return min((e.t for e in result.events if e.is_crash and e.t >= last), default=math.inf)


def marked_messages(found: list[tuple[float, int, str]]) -> list[list[Any]]:
    """The worst MAX_MESSAGES messages as [t, severity, text]; severity 2 is an alarm, 1 a warning, 0 the rest."""
    graded: list[list[Any]] = [
        [t, 2 if alarming(level, text) else 1 if level <= WARNING else 0, text[:200]] for t, level, text in found
    ]
    if len(graded) > MAX_MESSAGES:
        worst = sorted(range(len(graded)), key=lambda i: -graded[i][1])[:MAX_MESSAGES]
        graded = [graded[i] for i in sorted(worst)]
    return graded


# Long lines made short, the range that shows them, and an arrow where one leaves it.

Array = NDArray[np.float64]

BUCKETS = 600
"""Of a line: two to a pixel of the column."""
CALM = 8.0
"""In a calm figure a row that moves so many times as far as the middle one may leave it."""
FAR = 0.985
"""Share of the values that set a range: a bump on landing leaves the figure."""


MOSTLY = 0.05
"""A row more of whose values leave the figure is drawn pale: else its strokes hide the others."""


def thinned(t: Array, y: Array, span: tuple[float, float] | None = None, wraps: bool = False) -> tuple[Array, Array]:
    """Smallest and largest value (and a gap) of each bucket of a line (n,) within a span; a full turn breaks it."""
    if span is not None:
        a, b = np.searchsorted(t, span[0], "left"), np.searchsorted(t, span[1], "right")
        t, y = t[max(a - 1, 0) : b + 1], y[max(a - 1, 0) : b + 1]
    if len(t) > 2 * BUCKETS:
        edges = np.linspace(0, len(t), BUCKETS + 1).astype(np.int64)
        kept = _extremes(y, edges)
        t, y = t[kept], y[kept]
    if wraps:
        turns = np.flatnonzero(np.abs(np.diff(y)) > 180.0) + 1
        t, y = np.insert(t, turns, t[turns]), np.insert(y, turns, np.nan)
    return t, y


def _extremes(y: Array, edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the smallest, the largest and the first missing value of each bucket are, in order."""
    buckets = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    by_size = np.lexsort((y, buckets))  # what is missing comes last in its bucket
    known = np.bincount(buckets[np.isfinite(y)], minlength=len(edges) - 1)
    some = known > 0
    low, high = by_size[edges[:-1][some]], by_size[(edges[:-1] + known - 1)[some]]
    holes = by_size[(edges[:-1] + known)[known < np.diff(edges)]]
    return np.unique(np.concatenate([low, high, holes]))


def fitted(
    canvas: Canvas,
    traces: Iterable[dict[str, Any]],
    least: float,
    calm: bool = False,
    between: tuple[float, float] = (-np.inf, np.inf),
) -> list[float]:
    """A range, ``least`` wide or wider, for lines: diverged rows do not set it; values not ``between`` do not."""
    lines = [(t.get("meta"), as_array(t["x"]), as_array(t["y"])) for t in traces]
    sound = [line for line in lines if line[0] is None or not canvas.rows[line[0]].lost] or lines
    if calm and sound:
        travel = [float(np.nanmax(y) - np.nanmin(y)) if np.isfinite(y).any() else 0.0 for _, _, y in sound]
        far = CALM * sorted(travel)[len(travel) // 2]
        sound = [line for line, moved in zip(sound, travel, strict=True) if moved <= far] or sound
    start = between[0] if any(len(x) and x[-1] > between[0] for _, x, _ in sound) else -np.inf
    end = between[1] if any(len(x) and x[0] < between[1] for _, x, _ in sound) else np.inf
    parts = [y[(x >= start) & (x <= end) & np.isfinite(y)] for _, x, y in sound]
    values = np.concatenate([*parts, np.zeros(0)])
    if not len(values):
        return [-least, least]
    low, high = float(values.min()), float(values.max())
    pad = max(0.06 * (high - low), 0.5 * (least - (high - low)), 1e-6)
    return [low - pad, high + pad]


def quantile(values: Array, p: float) -> float:
    """The value that a share of all lies below."""
    ordered = np.sort(values[np.isfinite(values)])
    return float(ordered[min(int(p * len(ordered)), len(ordered) - 1)]) if len(ordered) else 0.0


def within(t: Array, y: Array, span: tuple[float, float]) -> Array:
    """Finite values of a line in a span."""
    return y[np.isfinite(y) & (t >= span[0]) & (t <= span[1])]


def leaving(canvas: Canvas) -> None:
    """An arrow at the edge where the line of a row leaves the figure; one that mostly does is pale."""
    for t in list(canvas.traces):
        key = t.get("yaxis", "y")
        ax = canvas.axes.get("yaxis" + key[1:], {})
        if t.get("meta") is None or "fill" in t or t.get("mode") != "lines" or "range" not in ax:
            continue
        x, y = as_array(t["x"]), as_array(t["y"])
        seen = canvas.axes["xaxis"].get("range", [-np.inf, np.inf])
        here = (x >= seen[0]) & (x <= seen[1])
        for edge, beyond, symbol in ((1, y > ax["range"][1], "triangle-up"), (0, y < ax["range"][0], "triangle-down")):
            out = np.flatnonzero(beyond & here)
            if len(out) > MOSTLY * len(y):
                t["opacity"] = 0.35
            if len(out):
                marker = {"symbol": symbol, "size": 6, "color": canvas.rows[t["meta"]].colour}
                canvas.marker([x[out[0]]], [ax["range"][edge]], marker, yaxis=key, cliponaxis=False, hoverinfo="skip")


def beyond(canvas: Canvas, colour: str, t: Array, y: Array, top: float) -> None:
    """Arrows at the upper edge for values beyond it."""
    out = y > top
    if out.any():
        marker = {"symbol": "triangle-up", "size": 5, "color": colour}
        canvas.marker(t[out], np.full(int(out.sum()), top), marker, cliponaxis=False, hoverinfo="skip")


# Panels one above the other that share flight time, and what stands on that axis.

GAP = 0.05
"""Between panels, as a share of the figure."""
MANY_MARKS = 80
"""More marks of a kind than these cannot be seen singly: they are not drawn."""
MOST_ALARMS = 60


@dataclass(frozen=True, slots=True)
class Panel:
    """A column of the traces with the title of its axis. ``cut``: where the circle of headings is cut open, deg."""

    key: str
    title: str
    least: float = 0.2
    wraps: bool = False
    cut: float | None = None
    more: dict[str, Any] = field(default_factory=dict)

    def line(self, stored: dict[str, Any], span: tuple[float, float]) -> tuple[Any, Any]:
        """Times and values of stored lines in this panel."""
        y = as_array(stored["y"][self.key])
        if self.cut is not None:
            y = y - 360.0 * np.floor((y - self.cut) / 360.0)
        return thinned(as_array(stored["t"]), y, span, self.wraps)


def domains(n: int) -> list[list[float]]:
    """The vertical places of ``n`` panels from the top down."""
    height = (1.0 - GAP * (n - 1)) / n
    return [[max(1.0 - i * (height + GAP) - height, 0.0), 1.0 - i * (height + GAP)] for i in range(n)]


def axis_key(i: int) -> str:
    """What the vertical axis of panel ``i`` is called: y, y2, y3."""
    return f"y{i + 1}" if i else "y"


def panels(
    canvas: Canvas,
    series: Sequence[dict[str, Any]],
    columns: Sequence[Panel],
    span: tuple[float, float],
    *,
    calm: bool = False,
    between: tuple[float, float] = (-np.inf, np.inf),
) -> None:
    """Lines of the rows in each panel, below them the time; what is ``between`` sets the ranges."""
    canvas.height = 72.0 * len(columns) if len(columns) > 1 else 120.0
    place = domains(len(columns))
    canvas.axes["xaxis"] = time_axis(span, axis_key(len(columns) - 1))
    for i, panel in enumerate(columns):
        key = axis_key(i)
        for s in canvas.drawn_rows(series):
            if panel.key in s["y"]:
                canvas.row(s["r"], *panel.line(s, span), yaxis=key)
        own = [t for t in canvas.traces if t.get("yaxis") == key]
        seen = fitted(canvas, own, panel.least, calm, between)
        canvas.axes["yaxis" + key[1:]] = axis(panel.title, domain=place[i], nticks=5, range=seen) | panel.more
    leaving(canvas)


def before_the_crash(canvas: Canvas, start: float = -np.inf) -> tuple[float, float]:
    """From when to when values set ranges, where a flight ended in a crash."""
    crash = canvas.marks["crash"]
    return start, np.inf if crash is None else float(crash)


def time_axis(span: tuple[float, float], anchor: str = "y") -> dict[str, Any]:
    """The axis of flight time."""
    return below("time, s", range=list(span), anchor=anchor)


def phases(canvas: Canvas) -> None:
    """In the air, at rest, impact, gaps and jumps behind a figure of flight time."""
    marks, (low, high), colours = canvas.marks, canvas.span, palette()

    def seen(kind: str) -> list[list[Any]]:
        return [m for m in marks[kind] if (m[1] if len(m) > 2 else m[0]) >= low and m[0] <= high]

    def few(kind: str) -> list[list[Any]]:
        return found if len(found := seen(kind)) <= MANY_MARKS else []

    for a, b, *_ in marks["airborne"]:
        canvas.band(a, b, colours["arm"])
    for a, b, *_ in few("rest"):
        canvas.band(a, b, colours["rest"])
    for a, b, *_ in marks["impact"]:
        canvas.band(a, max(a, b), colours["crash"])
        canvas.upright(a, colours["bad"])
    for a, b, *_ in few("gaps"):
        canvas.band(a, b, colours["gap"])
        canvas.key(Key("gap", colours["mu"], fill=True))
    for t, *_ in few("resets"):
        canvas.upright(t, colours["bad"], DOT)
        canvas.key(Key("jump of onboard", colours["bad"], DOT))
    _labels(canvas)


def _labels(canvas: Canvas) -> None:
    """The names of phases above their places, where there is room between them."""
    low, high = canvas.span
    taken: list[tuple[float, float]] = []
    words = [(a, a, "impact") for a, *_ in canvas.marks["impact"] if low <= a <= high]
    words += [(a, b, "in the air") for a, b, *_ in canvas.marks["airborne"]]
    words += [(a, b, "rest") for a, b, *_ in canvas.marks["rest"]]
    for a, b, word in words:
        if b < low or a > high:
            continue
        middle = 0.5 * (max(a, low) + min(b, high))
        half = 0.5 * (text_width(word) + 4.0) / canvas.inside * (high - low)
        fits = word == "impact" or min(b, high) - max(a, low) >= 2.0 * half
        if fits and all(middle + half < a or middle - half > b for a, b in taken):
            taken.append((middle - half, middle + half))
            canvas.note(middle, word, palette()["bad"] if word == "impact" else INK)
        elif word == "in the air":
            canvas.key(Key(word, palette()["mu"], fill=True))


def alarms(canvas: Canvas) -> None:
    """Failsafes and critical messages as dashed lines."""
    times = [t for t, level, _ in canvas.marks["texts"] if level == 2 and canvas.span[0] <= t <= canvas.span[1]]
    for t in times[:MOST_ALARMS]:
        canvas.upright(t, palette()["bad"], DASH)
        canvas.key(Key("failsafe, critical message", palette()["bad"], DASH))


def decades(values: NDArray[np.float64], most: int) -> dict[str, Any]:
    """1, 2, 5 of every decade as ticks of a logarithmic axis."""
    good = values[np.isfinite(values) & (values > 0)]
    if not len(good):
        return {}
    low, high = np.log10(good.min()), np.log10(good.max())
    steps = (1,) if high - low > 2 else (1, 2, 5)
    ticks = [m * 10.0**d for d in range(int(np.floor(low)), int(np.floor(high)) + 1) for m in steps]
    ticks = ticks[::2] if len(ticks) > 2 * most else ticks
    return {"tickvals": ticks, "ticktext": [f"{v:.10f}".rstrip("0").rstrip(".") if v < 1 else f"{v:g}" for v in ticks]}
