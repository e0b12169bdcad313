"""Convert a view for print: journal column, 8 pt, black axes, thinned lines, legend.

The page's script does the same for the screen (``web/plots.js``), again at every zoom.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import unique
from attlog.report.figures.figure import PageFigure, quantile
from attlog.report.figures.legend import INK, PT, TEXT, WIDTH, Key, legend, shortened, text_width
from attlog.report.figures.style import PRINT_DASHES, RowStyle, palette, print_dash, safe

Array = NDArray[np.float64]
Layout = dict[str, Any]

# Fonts that journals accept, and a free one with the same widths.
FONT = "Arial, Helvetica, Liberation Sans, sans-serif"
# Thinnest line that prints reliably.
AXIS_LINE = 0.5 * PT
DASHES = {"dash": "4px,2px", "dot": "1.2px,1.8px"}
# Ratio of print to page: heights, line widths, markers.
HEIGHT_SHARE, LINE_SHARE, MARKER_SHARE = 0.46, 0.67, 0.6
LEFT, RIGHT, BOTTOM = 54.0, 11.0, 34.0
# Height of flight modes below the time axis, pixels: a line of text.
MODE_HEIGHT = 13.0
# Buckets of a thinned line: two per pixel of the column.
BUCKETS = 600
# In a calm figure a row may leave the axis if its range exceeds the median one by this factor.
CALM = 8.0
# A row with a larger share of its values outside the figure is drawn pale.
MOSTLY = 0.05
# Above these numbers marks of a kind are indistinguishable and omitted.
MANY_MARKS, MAX_ALARMS, MAX_ARROWS = 80, 60, 60


class PrintedFigure:
    """View under conversion for print."""

    def __init__(
        self,
        figure: PageFigure,
        view: Layout,
        rows: Sequence[RowStyle],
        shown: set[int],
        marks: Layout,
        span: tuple[float, float],
    ) -> None:
        self.data = figure.data | view
        self.rows, self.shown, self.marks, self.span = rows, shown, marks, span
        self.keys: dict[str, Key] = {}
        self.left, self.right, self.above, self.below = LEFT, RIGHT, 0.0, BOTTOM
        self.height = max(HEIGHT_SHARE * figure.height, 66.0)
        if "size" in self.data:
            self.height = float(self.data["size"])
        self.axes = {name: dict(axis) for name, axis in self.data["axes"].items()}
        self.shapes = [dict(shape) for shape in self.data["shapes"]]
        self.notes = [dict(note) for note in self.data["notes"]]
        self.traces: list[Layout] = []
        self.timed = bool(self.data.get("timed"))

    @property
    def inside(self) -> float:
        """Pixels between the left and the right axis."""
        return WIDTH - self.left - self.right

    def finished(self) -> Layout:
        """Return ``data`` and ``layout`` for plotly."""
        self.place_rows()
        if "yaxis2" in self.axes and self.axes["yaxis2"].get("side") == "right":
            self.right = 44.0
        if "ticktext" in self.axes["yaxis"] and self.axes["yaxis"].get("type") != "log":
            self.left = max(self.left, 14.0 + max(map(text_width, self.axes["yaxis"]["ticktext"]), default=0.0))
        drawn = [t for t in self.data["traces"] if self.is_shown(t["meta"])]
        self.traces = [self.trace(t) for t in drawn]
        self.tell_apart()
        if self.timed:
            self.axes["xaxis"] |= {"range": list(self.span), "title": "time, s"}
        if "equal" in self.data:
            self.equal_scales(float(self.data["equal"]))
        for name, axis in self.axes.items():
            if (fit := axis.pop("fit", None)) is not None:
                axis["range"] = self.fitted(name[0] + name[5:], fit)
            if axis.pop("heading", False):
                axis |= heading_ticks(*axis["range"])
        self.leaving()
        for trace in list(self.traces):
            self.special(trace)
        if self.data.get("phases"):
            self.phases()
            if self.timed and self.marks["modes"]:
                self.modes()
        if self.data.get("alarms"):
            self.alarms()
        for trace in sorted(self.traces, key=lambda t: t["meta"].get("row", len(self.rows))):
            self.key_of(trace)
        return self.layout()

    def is_shown(self, meta: Layout) -> bool:
        """Return whether a trace's row is drawn and its band, if any, chosen."""
        row = meta.get("row", meta.get("band"))
        return (row is None or row in self.shown) and meta.get("band", self.data.get("band")) == self.data.get("band")

    def trace(self, found: Layout) -> Layout:
        """Convert a trace to print sizes and colours, with long lines thinned."""
        meta = found["meta"]
        trace: Layout = {"type": "scatter"} | coloured(found) | {"meta": meta}
        if "line" in trace:
            line = trace["line"] | {"width": LINE_SHARE * trace["line"]["width"]}
            dash = line.get("dash", "solid")
            style = self.rows[meta["row"]] if "row" in meta else None
            own = style is not None and dash == style.dash and not meta.get("keyless")
            line["dash"] = print_dash(style) if style is not None and own else DASHES.get(dash, dash)
            trace["line"] = line
        if "marker" in trace and trace["type"] == "scatter":
            size = trace["marker"].get("size", 6.0)
            trace["marker"] = trace["marker"] | {"size": MARKER_SHARE * size}
            if "line" in trace["marker"]:
                trace["marker"]["line"] = trace["marker"]["line"] | {"width": 1.0}
        for bars in ("error_x", "error_y"):
            if bars in trace:
                trace[bars] = {"color": trace.get("line", {}).get("color", INK)} | trace[bars]
                trace[bars] |= {"thickness": 0.67 if bars == "error_y" else 1.0, "width": 1.5}
        if trace["type"] == "bar":
            return self.clipped(trace)
        if meta.get("time") and trace.get("mode") == "lines":
            span = self.span if self.timed else None
            trace["x"], trace["y"] = thinned(trace["x"], trace["y"], span, bool(meta.get("wraps")))
        elif "t" in meta:
            kept = (meta["t"] >= self.span[0]) & (meta["t"] <= self.span[1])
            trace["x"], trace["y"] = trace["x"][kept], trace["y"][kept]
            trace["meta"] = meta | {k: meta[k][kept] for k in ("t", "angle") if k in meta}
            trace.pop("customdata", None)
            trace.pop("hovertemplate", None)
        elif self.timed and trace.get("mode") == "markers":
            kept = [self.span[0] <= float(t) <= self.span[1] for t in trace["x"]]
            for key in ("x", "y", "customdata"):
                if key in trace:
                    trace[key] = [v for v, keep in zip(trace[key], kept, strict=True) if keep]
        places = self.axes.get("yaxis" + trace.get("yaxis", "y")[1:], {}).get("places")
        if places is not None and "row" in meta:
            trace["y"] = [places[meta["row"]] + y for y in trace["y"]]
        return trace

    def tell_apart(self) -> None:
        """Give lines of no row that share an axis different dashes."""
        seen: dict[str, int] = {}
        for trace in self.traces:
            line = trace.get("line", {})
            own = "row" not in trace["meta"] and "group" not in trace["meta"] and trace.get("mode") == "lines"
            if own and line["width"] > 0.0 and line["dash"] == "solid" and "arrow" not in trace["meta"]:
                k = seen[trace.get("yaxis", "y")] = seen.get(trace.get("yaxis", "y"), -1) + 1
                line["dash"] = PRINT_DASHES[k % len(PRINT_DASHES)]

    def clipped(self, trace: Layout) -> Layout:
        """Clip bars of time to the span; keep names that fit."""
        low, high = self.span
        fills = trace["marker"]["color"]
        kept = []
        for i, (a, x) in enumerate(zip(trace["base"], trace["x"], strict=True)):
            start, end = max(a, low), min(a + x, high)
            if end > start:
                name = trace["text"][i]
                fits = (end - start) / (high - low) * self.inside > text_width(name) + 4.0
                kept.append((start, end - start, name if fits else "", fills[i] if isinstance(fills, list) else fills))
        base, x, text, colours = ([k[j] for k in kept] for j in range(4))
        found = {"base": base, "x": x, "text": text, "y": trace["y"][: len(kept)], "customdata": None}
        marker = {"color": colours, "line": {"width": 0}}
        return (
            {k: v for k, v in trace.items() if k != "hovertemplate"} | found | {"marker": marker, "hoverinfo": "skip"}
        )

    def place_rows(self) -> None:
        """Give each drawn row its line, from the top."""
        for name, axis in self.axes.items():
            rows = [r for r in axis.pop("rows", ()) if r in self.shown]
            if not rows:
                continue
            axis["places"] = {r: len(rows) - 1.0 - i for i, r in enumerate(rows)}
            names = [shortened(self.rows[r].name) for r in rows]
            if axis.pop("named", True):
                self.left = max(self.left, min(12.0 + max(map(text_width, names)), 0.42 * WIDTH))
                axis["ticktext"] = names
            else:
                axis["ticktext"] = []
            axis |= {"tickvals": list(axis["places"].values())[: len(axis["ticktext"])], "ticks": ""}
            axis["range"] = [-0.6, len(rows) - 0.4]
            self.axes[name] = axis
            if "size" not in self.data:
                several = len({r for r in rows}) < sum("ci" in t["meta"] for t in self.data["traces"])
                self.height = 16.0 * max(len(rows), 3) * (1.4 if several else 1.0)

    def fitted(self, key: str, fit: Layout) -> list[float]:
        """Return the range of an axis.

        Diverged rows, and values outside ``from`` and ``to``, do not extend it.
        """
        own = [t for t in self.traces if t.get("yaxis", "y") == key and not t["meta"].get("free")]
        lines = [(t["meta"].get("row"), as_array(t["x"]), as_array(t["y"])) for t in own]
        sound = [line for line in lines if line[0] is None or not self.rows[line[0]].lost] or lines
        if fit.get("calm") and sound:
            travel = [float(np.nanmax(y) - np.nanmin(y)) if np.isfinite(y).any() else 0.0 for _, _, y in sound]
            far = CALM * sorted(travel)[len(travel) // 2]
            sound = [line for line, moved in zip(sound, travel, strict=True) if moved <= far] or sound
        start, end = fit.get("from", -math.inf), fit.get("to", math.inf)
        start = start if any(len(x) and x[-1] > start for _, x, _ in sound) else -math.inf
        end = end if any(len(x) and x[0] < end for _, x, _ in sound) else math.inf
        parts = [y[(x >= start) & (x <= end) & np.isfinite(y)] for _, x, y in sound]
        share = fit.get("share", 0.0)
        values = [v for part in parts if len(part) for v in (quantile(part, share), quantile(part, 1.0 - share))]
        return padded([*values, *fit.get("include", ())], fit)

    def equal_scales(self, least: float) -> None:
        """Scale a metre equally on both axes."""
        lines = [t for t in self.traces if not t["meta"].get("free")]
        sides = []
        for key in ("x", "y"):
            known = [as_array(t[key])[np.isfinite(as_array(t["y"]))] for t in lines]
            values = np.concatenate([*known, np.zeros(0)])
            sides.append((quantile(values, 0.002), quantile(values, 0.998)))
        pixels = (self.inside, self.height)
        longest = [(high - low) / p for (low, high), p in zip(sides, pixels, strict=True)]
        scale = 1.15 * max(*longest, least / self.height)
        for axis, (low, high), p in zip(("xaxis", "yaxis"), sides, pixels, strict=True):
            middle = 0.5 * (low + high)
            self.axes[axis]["range"] = [middle - 0.5 * scale * p, middle + 0.5 * scale * p]

    def leaving(self) -> None:
        """Mark with an arrow where a line leaves the figure.

        Rows mostly outside are drawn pale.
        """
        low, high = self.axes["xaxis"].get("range", (-math.inf, math.inf))
        log = self.axes["xaxis"].get("type") == "log"
        for t in list(self.traces):
            meta, key = t["meta"], t.get("yaxis", "y")
            axis = self.axes.get("yaxis" + key[1:], {})
            drawn = ("row" in meta and "fill" not in t) or meta.get("beyond")
            if not drawn or t.get("mode") != "lines" or "range" not in axis or axis.get("type") == "log" or log:
                continue
            x, y = as_array(t["x"]), as_array(t["y"])
            here = (x >= low) & (x <= high)
            for edge, beyond, symbol in (
                (1, y > axis["range"][1], "triangle-up"),
                (0, y < axis["range"][0], "triangle-down"),
            ):
                out = beyond & here
                if not out.any():
                    continue
                if "row" in meta and out.sum() > MOSTLY * len(y):
                    t["opacity"] = 0.35
                starts = np.flatnonzero(out & ~np.concatenate([[False], out[:-1]]))
                at = x[starts if meta.get("beyond") else starts[:1]]
                marker = {"symbol": symbol, "size": 6, "color": t["line"]["color"]}
                own = {"type": "scatter", "mode": "markers", "x": at, "y": np.full(len(at), axis["range"][edge])}
                self.traces.append(
                    own | {"marker": marker, "yaxis": key, "cliponaxis": False, "hoverinfo": "skip", "meta": {}}
                )

    def special(self, trace: Layout) -> None:
        """Draw a line's arrows, or markers at a share of the height."""
        meta = trace["meta"]
        if "edge" in meta:
            low, high = self.axes["yaxis"]["range"]
            trace["y"] = [low + meta["edge"] * (high - low)] * len(trace["x"])
        if "arrow" not in meta:
            return
        ends = self.axes["yaxis"]["range"]
        long = 0.7 * meta["arrow"] * (ends[1] - ends[0]) / self.height
        at = spaced(trace["x"], trace["y"], np.flatnonzero(np.isfinite(meta["angle"])), 1.1 * long)
        angle = np.radians(meta["angle"][at])
        east, north = trace["x"][at], trace["y"][at]
        tips = east + long * np.sin(angle), north + long * np.cos(angle)
        gap = np.full(len(east), np.nan)
        trace["x"], trace["y"] = (
            np.column_stack([a, b, gap]).ravel() for a, b in zip((east, north), tips, strict=True)
        )
        marker = {"symbol": "triangle-up", "size": 4, "color": trace["line"]["color"], "angle": np.degrees(angle)}
        heads = {"type": "scatter", "mode": "markers", "x": tips[0], "y": tips[1], "marker": marker}
        self.traces.append(heads | {"hoverinfo": "skip", "meta": {}})

    def band(self, low: float, high: float, fill: str) -> None:
        """Shade a part of the horizontal axis."""
        place = {"xref": "x", "yref": "paper", "x0": low, "x1": high, "y0": 0, "y1": 1}
        self.shapes.append({"type": "rect", "layer": "below", "fillcolor": fill, "line": {"width": 0}} | place)

    def upright(self, x: float, dash: str) -> None:
        """Draw a red vertical line over the full height."""
        line = {"color": "bad", "width": AXIS_LINE / LINE_SHARE, "dash": dash}
        place = {"xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1}
        self.shapes.append({"type": "line", "layer": "below", "line": line} | place)

    def phases(self) -> None:
        """Shade flight, rest, impact and gaps, and mark jumps of the onboard attitude."""
        low, high = self.span

        def few(kind: str) -> list[list[Any]]:
            found = [m for m in self.marks[kind] if (m[1] if len(m) > 2 else m[0]) >= low and m[0] <= high]
            return found if len(found) <= MANY_MARKS else []

        for a, b, *_ in self.marks["airborne"]:
            self.band(a, b, "arm")
        for a, b, *_ in few("rest"):
            self.band(a, b, "rest")
        for a, b, *_ in self.marks["impact"]:
            self.band(a, max(a, b), "crash")
            self.upright(a, "solid")
        for a, b, *_ in few("gaps"):
            self.band(a, b, "gap")
            self.key(Key("gap", "mu", fill=True))
        for t, *_ in few("resets"):
            self.upright(t, "dot")
            self.key(Key("jump of onboard", "bad", DASHES["dot"]))
        self.phase_names()

    def phase_names(self) -> None:
        """Write the names of phases above them where there is room."""
        low, high = self.span
        taken: list[tuple[float, float]] = []
        words = [(a, a, "impact") for a, *_ in self.marks["impact"] if low <= a <= high]
        words += [(a, b, "in the air") for a, b, *_ in self.marks["airborne"]]
        words += [(a, b, "rest") for a, b, *_ in self.marks["rest"]]
        for a, b, word in words:
            if b < low or a > high:
                continue
            middle = 0.5 * (max(a, low) + min(b, high))
            half = 0.5 * (text_width(word) + 4.0) / self.inside * (high - low)
            fits = word == "impact" or min(b, high) - max(a, low) >= 2.0 * half
            if fits and all(middle + half < c or middle - half > d for c, d in taken):
                taken.append((middle - half, middle + half))
                place = {"x": middle, "y": 1, "xref": "x", "yref": "paper", "yanchor": "bottom"}
                self.notes.append(place | {"text": word, "font": {"color": "bad" if word == "impact" else "tx"}})
            elif word == "in the air":
                self.key(Key(word, "mu", fill=True))

    def modes(self) -> None:
        """Draw flight modes below the time axis, with their names where they fit."""
        low, high = self.span
        names = list(dict.fromkeys(name for *_, name in self.marks["modes"]))
        self.below += MODE_HEIGHT
        self.axes["xaxis"] |= {"ticklen": MODE_HEIGHT, "tickcolor": "rgba(0,0,0,0)"}
        place = {"xref": "x", "yref": "paper", "ysizemode": "pixel", "yanchor": 0, "y0": -1, "y1": -MODE_HEIGHT}
        written = {
            "y": 0,
            "xref": "x",
            "yref": "paper",
            "xanchor": "left",
            "yanchor": "middle",
            "font": {"color": "tx"},
        }
        shift = -(MODE_HEIGHT + 1.0) / 2.0
        for a, b, name in self.marks["modes"]:
            text = safe(name)
            start, end = max(a, low), min(b, high)
            width = (end - start) / (high - low) * self.inside
            if width < 1.0:
                continue
            fill = {"fillcolor": f"m{names.index(name) % 4}", "line": {"width": 0}, "layer": "below"}
            self.shapes.append({"type": "rect", "x0": start, "x1": end} | place | fill)
            if width > text_width(text) + 4.0:
                self.notes.append(written | {"x": start, "yshift": shift, "text": text, "font": {"color": "tx"}})

    def alarms(self) -> None:
        """Mark failsafes and critical messages with dashed lines."""
        times = [t for t, level, _ in self.marks["texts"] if level == 2 and self.span[0] <= t <= self.span[1]]
        for t in times[:MAX_ALARMS]:
            self.upright(t, "dash")
            self.key(Key("failsafe, critical message", "bad", DASHES["dash"]))

    def key(self, key: Key) -> None:
        """Add a legend entry; the first entry of a name is kept."""
        self.keys.setdefault(key.name, key)

    def key_of(self, trace: Layout) -> None:
        """Add the legend entry of a named trace."""
        meta, name = trace["meta"], trace.get("name")
        if not name or trace["type"] == "bar" or meta.get("keyless"):
            return
        if places := meta.get("places"):
            symbol = trace["marker"]["symbol"]
            full = trace["marker"]["color"] != "#ffffff"
            if not symbol.startswith(("triangle-left", "triangle-right")):
                self.key(Key(places, INK, symbol=symbol, full=full))
        elif "row" in meta and trace.get("mode") == "markers":
            return
        elif trace.get("mode") == "markers":
            symbol = trace["marker"].get("symbol", "circle")
            full = not symbol.endswith("-open")
            self.key(Key(name, trace["marker"]["color"], symbol=symbol.removesuffix("-open"), full=full))
        elif "fill" in trace:
            self.key(Key(name, trace["line"]["color"], fill=True))
        elif trace["line"]["width"] > 0.0:
            group = meta.get("group")
            line = trace["line"]
            self.key(Key(group or name, INK if group else line["color"], line["dash"], line["width"]))

    def layout(self) -> Layout:
        """Return traces and layout with print axes and the legend."""
        if any(n.get("yref") == "paper" and n.get("yanchor") == "bottom" and n.get("y") == 1 for n in self.notes):
            self.above = 1.2 * TEXT
        keys = [replace(key, colour=light(key.colour)) for key in self.keys.values()]
        if len(keys) == 1 and not (keys[0].fill or keys[0].symbol):
            keys = []  # a single line needs no legend: the axis names it
        shapes, texts, high = legend(keys, self.left, self.above)
        top = 6.0 + high + self.above
        several = "domain" in self.axes["yaxis"]
        axes = {name: print_axis(name, axis, several) for name, axis in self.axes.items()}
        layout: Layout = {
            "width": WIDTH,
            "height": round(self.height + top + self.below),
            "font": {"family": FONT, "size": TEXT, "color": INK},
            "margin": {"l": self.left, "r": self.right, "t": top, "b": self.below, "pad": 0},
            "paper_bgcolor": "#ffffff",
            "plot_bgcolor": "#ffffff",
            "showlegend": False,
            "barmode": "overlay",
            "shapes": [*map(print_shape, self.shapes), *shapes],
            "annotations": [*map(print_note, self.notes), *texts],
        }
        for trace in self.traces:
            trace["meta"] = trace["meta"].get("row")
        return {"data": self.traces, "layout": layout | axes}


def light(colour: str) -> str:
    """Return the light-theme colour of a name (``e1``, ``bad/0.2``), else the text."""
    name, slash, share = colour.partition("/")
    found = palette().get(name)
    if found is None:
        return colour
    return f"rgba({','.join(str(int(found[i : i + 2], 16)) for i in (1, 3, 5))},{share})" if slash else found


def coloured(value: Layout) -> Layout:
    """Replace colour names in traces or layout by light-theme colours."""

    def one(key: str, own: Any) -> Any:
        if isinstance(own, dict):
            return coloured(own)
        if key.endswith("color"):
            return [light(c) for c in own] if isinstance(own, list) else light(own) if isinstance(own, str) else own
        return own

    return {key: own if key == "meta" else one(key, own) for key, own in value.items()}


def print_axis(name: str, axis: Layout, several: bool) -> Layout:
    """Convert an axis for print: black, outward ticks, title."""
    title: Layout = {"text": axis.get("title", ""), "font": {"size": TEXT, "color": INK}}
    if name.startswith("x") or not several:
        title["standoff"] = 3  # with several panels the titles are aligned instead
    own = {
        "showline": True,
        "linecolor": INK,
        "linewidth": AXIS_LINE,
        "ticks": "outside",
        "ticklen": 3,
        "tickwidth": AXIS_LINE,
        "tickcolor": INK,
        "tickfont": {"size": TEXT, "color": INK},
        "automargin": False,
        "tickangle": 0,
        "exponentformat": "none",
        "nticks": 7 if name.startswith("x") else 6,
    }
    dropped = ("title", "places", "fixedrange", "showticklabels", "narrow")
    return (
        own
        | {k: v for k, v in axis.items() if k not in dropped}
        | {"title": title, "showgrid": False, "zeroline": False}
    )


def print_shape(shape: Layout) -> Layout:
    """Convert a shape to print widths and colours."""
    found = coloured(shape)
    line = found["line"]
    dash = line.get("dash", "solid")
    return found | {"line": line | {"width": LINE_SHARE * line["width"], "dash": DASHES.get(dash, dash)}}


def print_note(note: Layout) -> Layout:
    """Convert a text of the figure to print size."""
    font = {"size": TEXT, "color": light(note["font"]["color"])}
    return note | {"showarrow": False, "font": font}


def as_array(values: Any) -> Array:
    """Return numbers as an array, None as NaN."""
    return np.asarray(values, np.float64)


def padded(values: Sequence[float], fit: Layout) -> list[float]:
    """Return the axis range around values.

    Keys of ``fit``: pad, least, least_pad, floor, most.
    """
    least = fit.get("least", 0.0)
    if not values:
        return [-least or -1.0, least or 1.0]
    low, high = min(values), max(values)
    if (floor := fit.get("floor")) is not None:
        return [floor, min(max(high + fit["pad"] * (high - floor), least), fit.get("most", math.inf))]
    pad = max(fit.get("pad", 0.06) * (high - low), 0.5 * (least - (high - low)), fit.get("least_pad", 1e-6))
    return [low - pad, high + pad]


def heading_ticks(low: float, high: float) -> Layout:
    """Return ticks of a heading axis in compass degrees."""
    step = next((s for s in (1, 2, 5, 10, 20, 45) if (high - low) / s < 5), 90)
    ticks = np.arange(np.ceil(low / step) * step, high + 1e-9, step)
    return {"tickvals": ticks.tolist(), "ticktext": [str(int(v) % 360) for v in ticks]}


def thinned(t: Array, y: Array, span: tuple[float, float] | None = None, wraps: bool = False) -> tuple[Array, Array]:
    """Reduce a line (n,) to the extremes and gaps of each bucket."""
    t, y = np.asarray(t, np.float64), np.asarray(y, np.float64)
    if span is not None:
        a, b = np.searchsorted(t, span[0], "left"), np.searchsorted(t, span[1], "right")
        t, y = t[max(a - 1, 0) : b + 1], y[max(a - 1, 0) : b + 1]
    if len(t) > 2 * BUCKETS:
        kept = _extremes(y, np.linspace(0, len(t), BUCKETS + 1).astype(np.int64))
        t, y = t[kept], y[kept]
    if wraps:
        turns = np.flatnonzero(np.abs(np.diff(y)) > 180.0) + 1
        t, y = np.insert(t, turns, t[turns]), np.insert(y, turns, np.nan)
    return t, y


def _extremes(y: Array, edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the sorted indices of minimum, maximum and first gap of each bucket."""
    buckets = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    by_size = np.lexsort((y, buckets))  # missing values are last in their bucket
    known = np.bincount(buckets[np.isfinite(y)], minlength=len(edges) - 1)
    some = known > 0
    low, high = by_size[edges[:-1][some]], by_size[(edges[:-1] + known - 1)[some]]
    holes = by_size[(edges[:-1] + known)[known < np.diff(edges)]]
    return unique(np.concatenate([low, high, holes]))


def spaced(east: Array, north: Array, at: NDArray[np.int64], apart: float) -> NDArray[np.int64]:
    """Select places at least ``apart`` metres apart along the path, at most MAX_ARROWS."""
    if not len(at):
        return at
    flown = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east[at]), np.diff(north[at])))])
    step = max(apart, flown[-1] / MAX_ARROWS, 1e-9)
    places: NDArray[np.int64] = np.searchsorted(flown, np.arange(0.0, flown[-1] + step, step)).clip(max=len(at) - 1)
    return np.asarray(at[unique(places)])
