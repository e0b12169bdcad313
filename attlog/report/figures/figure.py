"""Figure data shared by page and print: plotly traces and axes with named colours.

A builder makes a :class:`PageFigure` from a :class:`FigureSource`. Its views have traces, axes, shapes and notes in
plotly's form, with three differences: arrays are numpy, colours are names of the style sheet (``e1``, ``bad/0.2``), and
additional keys are in ``meta`` of a trace (META_KEYS) and in ``fit`` of an axis (FIT_KEYS). The page's script and
:mod:`attlog.report.figures.paper` read these keys; no code of theirs depends on a single figure.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.bundle import ArrayPacker
from attlog.report.figures.style import RowStyle, row_styles, safe
from attlog.result import Answer, Result, Trace
from attlog.words.flight import WARNING, alarming, messages
from attlog.words.numbers import quantity, unit_sign
from attlog.words.text import cleaned

Array = NDArray[np.float64]

# Messages drawn on the time axis. The page's list has all.
MAX_MESSAGES = 2000
# Time after a crash (s) that figures show at first.
AFTER_CRASH_S = 5.0
# Shorter arrays are written into the page as numbers.
MIN_PACKED = 32
# Gap between stacked panels as a share of the figure.
PANEL_GAP = 0.035
ROW_WIDTH, ONBOARD_WIDTH, LINE_WIDTH = 1.5, 2.2, 1.3

META_KEYS = {
    "row": "position of the row; the legend hides its traces",
    "band": "position of the row whose band it is; one row's band is drawn",
    "unit": "unit as in the JSON, for the saved table",
    "say": "unit behind a number under the pointer",
    "digits": "decimals of that number, 2 without",
    "quantity": "name in the saved table; without one it is not saved",
    "columns": "what is saved in its place: name -> [values, unit]",
    "text": "what is saved in place of numbers",
    "value": "what is saved in place of the drawn place",
    "ci": "its interval",
    "low": "lower ends of intervals, saved and not drawn",
    "high": "upper ends",
    "n": "number of units of evidence",
    "time": "x is time: the line is reduced to what a screen can show",
    "t": "times of a line whose x is no time",
    "step": "step of the stored values",
    "log": "values of a logarithmic axis: stored as numbers",
    "wraps": "a full turn breaks the line",
    "cut": "where the circle of headings is cut open, deg",
    "free": "does not set the range of its axis",
    "beyond": "an arrow wherever it leaves the figure",
    "edge": "drawn at this share of the axis",
    "arrow": "length of the arrows that it becomes, px",
    "angle": "direction of the arrows, deg from north",
    "silent": "no number under the pointer, none saved",
    "quiet": "no number under the pointer",
    "keyless": "no entry in a legend",
    "group": "entry of the printed legend that several lines share",
    "places": "entry of the printed legend for its symbol",
}
FIT_KEYS = {
    "least": "smallest range",
    "pad": "free share at both ends, 0.06 without",
    "least_pad": "smallest free part at an end",
    "share": "share of the values that leave the figure at each end",
    "include": "values in the range",
    "floor": "fixed lower end",
    "most": "largest upper end",
    "calm": "rows that move far more than the middle one leave the figure",
    "from": "earlier values set no range",
    "to": "later values set no range",
}


@dataclass(slots=True)
class PageFigure:
    """Figure of the page.

    ``kind``: ``plot`` for figures of views, else the drawing function in another page's script. ``data`` has ``views``,
    each overriding the rest of ``data``; ``views`` are their names. ``bands``: rows with a selectable band, by position
    and name. ``words``: the figure's content for screen readers.
    """

    id: str
    kind: str
    title: str
    caption: str
    height: int
    data: dict[str, Any] = field(default_factory=dict)
    wide: bool = True
    words: str = ""
    views: list[str] = field(default_factory=list)
    bands: list[tuple[int, str]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class FigureSource:
    """Result with traces by kind and styles of rows."""

    result: Result
    styles: dict[str, RowStyle]
    by_kind: dict[str, list[Trace]]
    marks: dict[str, Any]

    @classmethod
    def of(cls, result: Result) -> FigureSource:
        """Group the traces that can be drawn."""
        styles = row_styles(result)
        by_kind: dict[str, list[Trace]] = {}
        for trace in result.traces:
            if (not trace.row or trace.row in styles) and len(trace.t):
                by_kind.setdefault(trace.figure, []).append(trace)
        return cls(result, styles, by_kind, time_marks(result))

    @property
    def rows(self) -> list[RowStyle]:
        """Styles of rows, in the order of the page."""
        return list(self.styles.values())

    def traces(self, kind: str) -> list[Trace]:
        """Return the traces of one kind, empty without any."""
        return self.by_kind.get(kind, [])

    def index(self, row: str) -> int:
        """Return the position of a row."""
        return list(self.styles).index(row)

    def by_depth(self, traces: Iterable[Trace]) -> list[tuple[int, Trace]]:
        """Sort traces for drawing: gyro at the bottom, onboard and reference, filters on top."""
        found = [(self.index(trace.row), trace) for trace in traces]
        return sorted(found, key=lambda one: self.rows[one[0]].depth)

    def view(self, name: str = "") -> View:
        """Return an empty view."""
        return View(self.rows, name)


@dataclass(frozen=True, slots=True)
class Panel:
    """Panel for one column of the traces.

    It has a title, a smallest range, and a line break at a full turn. ``cut``: angle at which the circle of headings is
    cut, deg.
    """

    key: str
    title: str
    least: float = 0.2
    wraps: bool = False
    cut: float | None = None
    axis: dict[str, Any] = field(default_factory=dict)


class View:
    """View of a figure: traces, axes, shapes and notes."""

    def __init__(self, rows: Sequence[RowStyle], name: str = "") -> None:
        self.rows, self.name = rows, name
        self.traces: list[dict[str, Any]] = []
        self.axes: dict[str, dict[str, Any]] = {}
        self.shapes: list[dict[str, Any]] = []
        self.notes: list[dict[str, Any]] = []

    def line(
        self,
        name: str,
        colour: str,
        x: Any,
        y: Any,
        *,
        unit: str = "",
        width: float = LINE_WIDTH,
        dash: str = "solid",
        meta: dict[str, Any] | None = None,
        **more: Any,
    ) -> dict[str, Any]:
        """Add a line without a row; ``meta``: see META_KEYS."""
        line = {"color": colour, "width": width} | ({} if dash == "solid" else {"dash": dash})
        own = {"unit": unit, "say": unit_suffix(unit)} | (meta or {})
        trace = {"mode": "lines", "x": x, "y": y, "name": safe(name), "line": line, "meta": own} | more
        self.traces.append(trace)
        return trace

    def row(self, r: int, x: Any, y: Any, *, meta: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
        """Add a line of a row, with its colour and dash."""
        style = self.rows[r]
        width = ONBOARD_WIDTH if style.onboard else ROW_WIDTH
        more = {"width": width, "dash": style.dash, **more}
        return self.line(style.name, f"e{style.slot}", x, y, meta={"row": r} | (meta or {}), **more)

    def band(self, name: str, colour: str, x: Any, low: Any, high: Any, *, opacity: float = 0.2, **more: Any) -> None:
        """Add a band between two invisible lines."""
        meta = {"silent": True} | more.pop("meta", {})
        self.line(name, colour, x, low, width=0, meta=meta, **more)
        fill = {"fill": "tonexty", "fillcolor": f"{colour}/{opacity}"}
        self.line(name, colour, x, high, width=0, meta=meta, **fill, **more)

    def markers(
        self, name: str, x: Any, y: Any, marker: dict[str, Any], *, unit: str = "", **more: Any
    ) -> dict[str, Any]:
        """Add points without a line."""
        meta = {"unit": unit, "say": unit_suffix(unit)} | more.pop("meta", {})
        trace = {"mode": "markers", "x": x, "y": y, "name": safe(name), "marker": marker, "meta": meta} | more
        self.traces.append(trace)
        return trace

    def axis(self, key: str, title: str, **more: Any) -> None:
        """Configure the axis ``x``, ``y`` or ``y2``."""
        self.axes[f"{key[0]}axis{key[1:]}"] = {"title": title} | more

    def span(self, low: float, high: float, fill: str, **more: Any) -> None:
        """Shade a part of the horizontal axis."""
        place = {"xref": "x", "yref": "paper", "x0": low, "x1": high, "y0": 0, "y1": 1}
        self.shapes.append({"type": "rect", "layer": "below", "fillcolor": fill, "line": {"width": 0}} | place | more)

    def upright(self, x: float, colour: str, dash: str = "solid", width: float = 1.2) -> None:
        """Draw a vertical line over the full height."""
        place = {"xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1}
        line = {"color": colour, "width": width, "dash": dash}
        self.shapes.append({"type": "line", "layer": "below", "line": line} | place)

    def level(self, y: float, colour: str, text: str, *, dash: str = "dash", right: bool = False) -> None:
        """Draw a horizontal line across the figure, with its text at one end."""
        place = {"xref": "paper", "yref": "y", "x0": 0, "x1": 1, "y0": y, "y1": y}
        self.shapes.append({"type": "line", "line": {"color": colour, "width": LINE_WIDTH, "dash": dash}} | place)
        side = {"x": 1, "xanchor": "right"} if right else {"x": 0, "xanchor": "left"}
        self.note(text, colour=colour, xref="paper", yref="y", y=y, **side)

    def level_line(self, name: str, y: float, colour: str, ends: Sequence[float]) -> None:
        """Draw a dashed line over flight time, with a legend entry."""
        self.line(name, colour, np.array(ends), np.array([y, y]), dash="dash", meta={"time": True, "silent": True})

    def note(self, text: str, *, colour: str = "mu", **place: Any) -> None:
        """Add a text to the figure, above the plot unless ``y`` is given."""
        above = {"y": 1, "xref": "x", "yref": "paper", "yanchor": "bottom"}
        self.notes.append(above | place | {"text": safe(text), "font": {"color": colour}})

    def panels(
        self, series: Sequence[tuple[int, Trace]], columns: Sequence[Panel], *, unit: str = "deg", **fit: Any
    ) -> None:
        """Stack panels on a shared time axis, each with the lines of all rows."""
        meta = {k: fit.pop(k) for k in ("step", "digits") if k in fit}
        time = fit.pop("time", True)
        for i, panel in enumerate(columns):
            key = axis_key(i)
            for r, trace in series:
                if panel.key in trace.columns:
                    y = panel_values(panel, trace)
                    own = meta | {"time": time, "quantity": panel.title.partition(",")[0]} | panel_meta(panel)
                    self.row(r, trace.t, y, unit=unit, yaxis=key, meta=own)
            self.axis(
                key,
                panel.title,
                domain=panel_domain(i, len(columns)),
                nticks=5,
                fit={"least": panel.least} | fit,
                **panel.axis,
            )
        self.axis("x", "time, s", anchor=axis_key(len(columns) - 1))

    def as_data(self) -> dict[str, Any]:
        """Return the view as a dictionary that still has numpy arrays."""
        return {"traces": self.traces, "axes": self.axes, "shapes": self.shapes, "notes": self.notes}


def axis_key(i: int) -> str:
    """Return the name of the vertical axis of panel ``i``: y, y2, y3."""
    return f"y{i + 1}" if i else "y"


def panel_domain(i: int, count: int) -> list[float]:
    """Return the vertical range of panel ``i`` of ``count``, from the top."""
    height = (1.0 - PANEL_GAP * (count - 1)) / count
    top = 1.0 - i * (height + PANEL_GAP)
    return [max(top - height, 0.0), top]


def panel_values(panel: Panel, trace: Trace) -> Array:
    """Return the column of a panel; headings are cut if the panel requires it."""
    y = np.asarray(trace.columns[panel.key], np.float64)
    return y if panel.cut is None else y - 360.0 * np.floor((y - panel.cut) / 360.0)


def panel_meta(panel: Panel) -> dict[str, Any]:
    """Return the additional keys (META_KEYS) of a trace in a panel."""
    return ({"wraps": True} if panel.wraps else {}) | ({} if panel.cut is None else {"cut": panel.cut})


def unit_suffix(unit: str) -> str:
    """Return the unit as it follows a number: ``°``, `` µT``."""
    sign = unit_sign(unit)
    return sign if sign.startswith(("°", "×")) or not sign else f" {sign}"


def figure_data(data: dict[str, Any], packer: ArrayPacker) -> dict[str, Any]:
    """Return figure data as JSON with clean texts; arrays of its traces go to the packer."""
    found = {name: value if name in ("traces", "views") else cleaned(value) for name, value in data.items()}
    if "traces" in data:
        found["traces"] = [_packed_trace(trace, packer) for trace in data["traces"]]
    if "views" in data:
        found["views"] = [figure_data(view, packer) for view in data["views"]]
    return found


def _packed_trace(trace: dict[str, Any], packer: ArrayPacker) -> dict[str, Any]:
    """Pack the arrays of a trace.

    Times are exact, values 16-bit steps, values of logarithmic axes numbers.
    """
    meta = dict(trace["meta"])
    step, log, time = meta.pop("step", 1e-9), meta.pop("log", False), meta.get("time", False)

    def pack(key: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {k: pack(k, v) for k, v in value.items()}
        if isinstance(value, list) and any(isinstance(v, np.ndarray) for v in value):
            return [pack("", v) for v in value]
        if not isinstance(value, np.ndarray):
            return cleaned(value)
        if log or len(value) < MIN_PACKED:
            return json_numbers(value)
        if key == "t" or (key == "x" and time):
            return packer.times(value)
        return packer.values(value, step if key == "y" else 1e-9)

    return {key: pack(key, value) for key, value in (trace | {"meta": meta}).items()}


def json_numbers(y: Any) -> list[float | None]:
    """Return a short array as JSON numbers of five digits, null for non-finite values."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in np.asarray(y, np.float64).tolist()]


def time_marks(result: Result) -> dict[str, Any]:
    """Collect marks of the time axes.

    Spans are [t0, t1, reason], instants [t, reason], then modes and texts.
    """
    line = result.log.get("timeline") or {}
    first, last = time_range(result)
    crash = crash_time(result)
    return {
        "range": [first, last],
        "first": [first, min(last, crash + AFTER_CRASH_S)],
        "crash": crash if crash < last else None,
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
    """Return segments of a kind as [t0, t1, reason]; ``rest``: long and short."""
    return [[s.t0, s.t1, s.why] for s in result.segments if s.kind.partition(".")[0] == kind]


def attitude_jumps(result: Result) -> list[list[Any]]:
    """Return jumps of the onboard attitude among the events as [t, text]."""
    return [[e.t, e.text] for e in result.events if e.kind == "reset"]


def time_range(result: Result) -> list[float]:
    """Return the first and last second that figures of flight time show."""
    times = [float(x) for t in result.traces if t.figure == "attitude" and len(t.t) for x in (t.t[0], t.t[-1])]
    end = max([*times, float(result.log.get("duration_s") or 0.0), 1e-3])
    return [min([*times, 0.0]), end]


def crash_time(result: Result) -> float:
    """Return the time of the last flight's crash, s; infinite without a crash."""
    flights = [float(a) for a, _ in (result.log.get("timeline") or {}).get("airborne") or []]
    last = max(flights, default=-math.inf)
    return min((e.t for e in result.events if e.is_crash and e.t >= last), default=math.inf)


def marked_messages(found: list[tuple[float, int, str]]) -> list[list[Any]]:
    """Return the most severe MAX_MESSAGES messages as [t, severity, text].

    Severity 2: alarm, 1: warning, 0: other.
    """
    graded: list[list[Any]] = [
        [t, 2 if alarming(level, text) else 1 if level <= WARNING else 0, text[:200]] for t, level, text in found
    ]
    if len(graded) > MAX_MESSAGES:
        worst = sorted(range(len(graded)), key=lambda i: -graded[i][1])[:MAX_MESSAGES]
        graded = [graded[i] for i in sorted(worst)]
    return graded


def sampling_text(traces: Sequence[Trace]) -> str:
    """Return the sentence about omitted samples."""
    whole, kept = sum(len(t.t) * t.ratio for t in traces), sum(len(t.t) for t in traces)
    ratio = whole / kept if kept else 1.0
    if ratio <= 1.005:
        return "Every sample is stored."
    return f"Stored: smallest and largest value of each interval, 1 in {ratio:.1f} samples; no peak is lost."


def range_words(traces: Iterable[Trace], source: FigureSource, unit: str = "deg") -> str:
    """Describe lines in words: smallest and largest value of each row and column."""
    rows: dict[str, list[str]] = {}
    for trace in traces:
        for column, y in trace.columns.items():
            good = np.asarray(y, np.float64)[np.isfinite(y)]
            if len(good):
                ends = f"{quantity(float(good.min()), unit, False)} to {quantity(float(good.max()), unit, False)}"
                rows.setdefault(trace.row, []).append(f"{column} {ends}")
    return "; ".join(f"{source.styles[row].name}: {', '.join(parts)}" for row, parts in rows.items())


def quantile(values: Array, p: float) -> float:
    """Return the quantile of values at share ``p``."""
    ordered = np.sort(values[np.isfinite(values)])
    return float(ordered[min(int(p * len(ordered)), len(ordered) - 1)]) if len(ordered) else 0.0


def decades(values: Array, most: int = 8) -> dict[str, Any]:
    """Return ticks of a logarithmic axis: 1, 2 and 5 of every decade."""
    good = values[np.isfinite(values) & (values > 0)]
    if not len(good):
        return {}
    low, high = np.log10(good.min()), np.log10(good.max())
    steps = (1,) if high - low > 2 else (1, 2, 5)
    ticks = [m * 10.0**d for d in range(int(np.floor(low)), int(np.floor(high)) + 1) for m in steps]
    ticks = ticks[::2] if len(ticks) > 2 * most else ticks
    return {"tickvals": ticks, "ticktext": [f"{v:.10f}".rstrip("0").rstrip(".") if v < 1 else f"{v:g}" for v in ticks]}


def is_number(x: Any) -> bool:
    """Return whether x is a finite number."""
    return isinstance(x, (int, float, np.number)) and not isinstance(x, bool) and math.isfinite(x)


def interval_of(answer: Answer) -> list[float] | None:
    """Return the 95 % interval; None if missing or infinite."""
    return [float(x) for x in answer.ci95] if answer.ci95 and all(map(is_number, answer.ci95)) else None
