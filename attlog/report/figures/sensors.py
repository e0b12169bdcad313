"""The compass: its three axes against the earth's field, and its size against the motors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import (
    Canvas,
    Key,
    PageFigure,
    Rows,
    as_array,
    json_numbers,
    packed_series,
    packed_trace,
    range_words,
    reduction_text,
)
from attlog.report.figures.panels import (
    FAR,
    Panel,
    axis_key,
    before_the_crash,
    beyond,
    domains,
    panels,
    phases,
    quantile,
    thinned,
    time_axis,
    within,
)
from attlog.report.figures.style import (
    AXIS_DASHES,
    DASH,
    DOT,
    INK,
    LINE,
    MARKER,
    PRINT_DASHES,
    STRONG,
    axis,
    below,
    faded,
    palette,
)
from attlog.report.figures.vibration import spectrum_figure, vibration_figure
from attlog.result import Result, Trace
from attlog.words.names import truth_name
from attlog.words.numbers import MINUS, duration, number, quantity

COMPASS_AXES = ("x", "y", "z")
FIELD_STEP = 0.01
"""uT per stored step."""
DRIVES = {"current": ("current, A", "A", "the current"), "throttle": ("throttle, %", "%", "the throttle")}


def compass_figure(traces: list[Trace], store: ArrayPacker, result: Result) -> PageFigure:
    """Measured, expected and, where an offset is offered, corrected field in body axes, a compass at a time."""
    views: list[dict[str, Any]] = [
        packed_trace(
            t, tuple(f"{part}{a}" for part in ("", "expected_", "corrected_") for a in COMPASS_AXES), store, FIELD_STEP
        )
        for t in traces
    ]
    first = traces[0]
    whose = "by motion alone, without any compass" if first.values.get("by_motion") else f"by {attitude_words(result)}"
    caption = f"Colour: measured. Dashes: the earth's field, turned {whose}."
    caption += " Dotted: with the offset that can be set." if "corrected_x" in first.columns else ""
    words = "; ".join(
        f"{a} off by {quantity(median_residual(first, a), 'uT', True)} in the median" for a in COMPASS_AXES
    )
    called = [t.key for t in traces]
    title = "Magnetic field in body axes, µT"
    return PageFigure("compass", "compass", title, caption, 500, {"views": views}, True, words, called)


def attitude_words(result: Result) -> str:
    """Whose attitude turned the earth's field, in words."""
    choice = result.reference.choice if result.reference else "onboard"
    return {"truth": truth_name(result), "smoother": "the smoother"}.get(choice, "the onboard attitude")


def median_residual(trace: Trace, axis: str) -> float:
    """Median of measured less expected field, uT."""
    off = np.asarray(trace.columns[axis] - trace.columns[f"expected_{axis}"], np.float64)
    off = off[np.isfinite(off)]
    return float(np.median(off)) if len(off) else float("nan")


def interference_figure(trace: Trace) -> PageFigure:
    """Points of the field's size less the earth's against the drive, and the fitted line."""
    label, unit, what = DRIVES.get(trace.key, ("drive", "", "the drive"))
    value = trace.values
    slope = f"{value['slope']:+.3f}".replace("-", MINUS)
    caption = f"Size of the field less the earth's against {what} in flight, {duration(value.get('seconds'))}. "
    caption += f"Line: {slope} µT per {unit}, r = {value['r']:.2f}".replace("-", MINUS) + "."
    data = {
        "x": json_numbers(trace.t),
        "y": json_numbers(trace.columns["residual"]),
        "label": label,
        "unit": unit,
        "drive": trace.key,
        "line": [value["start"], value["slope"]],
    }
    words = f"{slope} µT per {unit}"
    title = f"Magnetic field against {trace.key}, µT"
    return PageFigure("interference", "interference", title, caption, 330, data, False, words)


# What the onboard estimator rejects: test ratios of its aids over the flight.

RATIO_STEP = 0.001
AIDS = ("compass", "velocity", "position", "height", "airspeed")
"""Each has its colour; others share the rest of the palette."""


def ratios_figure(traces: list[Trace], store: ArrayPacker) -> PageFigure:
    """A line for each aid, 1 is the gate of the firmware."""
    known = sorted(traces, key=lambda t: AIDS.index(t.key) if t.key in AIDS else len(AIDS))
    lines = []
    for i, trace in enumerate(known):
        slot = AIDS.index(trace.key) if trace.key in AIDS else max(i, len(AIDS))
        lines.append({"aid": trace.key, "slot": 1 + slot % 8, **packed_trace(trace, ("ratio",), store, RATIO_STEP)})
    highest = ", ".join(f"{t.key} {number(float(t.columns['ratio'].max()))}" for t in known)
    caption = "Distance of each aid from the onboard estimator's prediction, as a share of its gate. "
    caption += "Above 1: rejected. ▲ beyond the figure."
    title = "Test ratios of the onboard estimator"
    return PageFigure("ratios", "ratios", title, caption, 330, {"lines": lines}, True, f"Highest: {highest}")


# The sensors themselves: compass, vibration, what the onboard estimator rejects, gravity, gyro bias.

AXES = ("x", "y", "z")
SIZE_WORDS = {
    "gravity": ("Size of the acceleration", "m/s²", "gravity at the place", "standing still it shows gravity"),
    "field": ("Size of the magnetic field", "µT", "the earth's field there", "motors and iron change it"),
}


def sensor_figures(by: dict[str, list[Trace]], names: Rows, store: ArrayPacker, result: Result) -> list[PageFigure]:
    """In the order of the questions. The field's size alone is drawn where nothing tells its direction."""
    figures = []
    if by.get("compass"):
        figures.append(compass_figure(by["compass"], store, result))
    elif by.get("field"):
        figures.append(size_figure(by["field"][0], by.get("throttle", [])))
    if by.get("interference"):
        figures.append(interference_figure(by["interference"][0]))
    if by.get("vibration") or by.get("levels"):
        figures.append(vibration_figure(by.get("levels", []), by.get("vibration", []), by.get("clipping", [])))
    if by.get("spectrum"):
        figures.append(spectrum_figure(by["spectrum"], by.get("rotor", []), by.get("notches", [])))
    if by.get("gravity"):
        figures.append(size_figure(by["gravity"][0], by.get("throttle", [])))
    if by.get("ratios"):
        figures.append(ratios_figure(by["ratios"], store))
    if by.get("bias") or by.get("rest_bias"):
        figures.append(bias_figure(by.get("bias", []), by.get("rest_bias", []), names, store))
    return figures


def size_figure(trace: Trace, throttle: list[Trace]) -> PageFigure:
    """Smallest, mean and largest size over time, what is expected, and the throttle."""
    title, unit, expected, why = SIZE_WORDS[trace.figure]
    caption = f"Line: mean, band: smallest to largest; {why}."
    data: dict[str, Any] = {"t": json_numbers(trace.t), "unit": unit}
    data |= {c: json_numbers(trace.columns[c]) for c in ("low", "mean", "high")}
    if "expected" in trace.values:
        data["expected"] = trace.values["expected"]
        caption += f" Dashed: {expected}, {trace.values['expected']:.1f} {unit}."
    if throttle:
        data["throttle"] = [json_numbers(throttle[0].t), json_numbers(throttle[0].columns["throttle"])]
        caption += " Grey: throttle."
    low, high = float(trace.columns["low"].min()), float(trace.columns["high"].max())
    return PageFigure(trace.figure, "size", title, caption, 330, data, False, f"{low:.1f} to {high:.1f} {unit}")


def bias_figure(found: list[Trace], rests: list[Trace], names: Rows, store: ArrayPacker) -> PageFigure:
    """Gyro bias that the filters found, beside what the gyro shows at rest."""
    drawn, ratio = packed_series(found, AXES, names, store, 1e-4)
    caption = "Subtracted from the logged gyro. Filters without a bias state are not drawn. "
    if any(t.row == "onboard" for t in found):
        caption += f"{names[names.index('onboard')]}: what the autopilot's own estimator logged. "
    data: dict[str, Any] = {"series": drawn}
    if rests:
        data["rests"] = {"t": json_numbers(rests[0].t)} | {a: json_numbers(rests[0].columns[a]) for a in AXES}
        caption += "● what the gyro shows at rest. "
    title = "Gyro bias that the filters found" if found else "Gyro bias at rest"
    return PageFigure(
        "bias", "bias", title, caption + reduction_text(ratio), 430, data, True, range_words(found, names, "deg/s")
    )


# The sensors themselves: gyro bias, sizes of gravity and field, vibration, what the onboard estimator rejects.

HIGHEST_RATIO = 4.0
MAX_LIMIT_FACTOR = 6.0
"""A limit beyond so many times the highest level is not shown."""
BODY_AXES = ("x", "y", "z")


def draw_bias(canvas: Canvas, data: dict[str, Any]) -> None:
    """Gyro bias that filters found, and what the gyro shows at rest."""
    panels(
        canvas,
        data["series"],
        [Panel(a, f"{a}, °/s", 0.02) for a in BODY_AXES],
        canvas.span,
        between=before_the_crash(canvas),
    )
    for i, a in enumerate(BODY_AXES if "rests" in data else ()):
        key = f"y{i + 1}" if i else "y"
        y = as_array(data["rests"][a])
        marker = {"size": MARKER, "color": INK}
        canvas.marker(as_array(data["rests"]["t"]), y, marker, yaxis=key, name="gyro at rest")
        seen = canvas.axes["yaxis" + key[1:]]["range"]
        low, high = min(seen[0], float(y.min())), max(seen[1], float(y.max()))
        pad = 0.06 * (high - low)
        canvas.axes["yaxis" + key[1:]]["range"] = [
            min(seen[0], float(y.min()) - pad),
            max(seen[1], float(y.max()) + pad),
        ]
    phases(canvas)


def draw_size(canvas: Canvas, data: dict[str, Any]) -> None:
    """Mean size with the band of smallest to largest, what is expected, and the throttle."""
    tint, t = palette()["e1"], as_array(data["t"])
    low, mean, high = (as_array(data[k]) for k in ("low", "mean", "high"))
    if "throttle" in data:
        x, y = (as_array(part) for part in data["throttle"])
        canvas.plain("throttle", INK, x, y, yaxis="y2", line={"color": palette()["edge"], "width": LINE})
        ticks = {"tickvals": [0, 50, 100], "overlaying": "y", "side": "right"}
        canvas.axes["yaxis2"] = axis("throttle, %", range=[0, 100], **ticks)
        canvas.right = 44.0
    canvas.edge(t, low)
    canvas.edge(t, high, fill="tonexty", fillcolor=faded(tint, 0.25))
    canvas.plain("mean", tint, t, mean)
    canvas.key(Key("smallest to largest", tint, fill=True))
    wanted = [data["expected"]] if "expected" in data else []
    bottom = min([quantile(within(t, low, canvas.span), 1.0 - FAR), *wanted])
    top = max([quantile(within(t, high, canvas.span), FAR), *wanted])
    pad = 0.15 * (top - bottom) or 1.0
    beyond(canvas, tint, t, high, top + pad)
    for value in wanted:
        canvas.plain("expected", INK, list(canvas.span), [value, value], line={"dash": DASH})
    canvas.axes["xaxis"] = time_axis(canvas.span)
    canvas.axes["yaxis"] = axis(
        f"{QUANTITIES.get(data['unit'], 'size')}, {data['unit']}", range=[bottom - pad, top + pad]
    )
    phases(canvas)


QUANTITIES = {"m/s²": "acceleration", "µT": "magnetic field"}
"""What has a size in this unit."""


def draw_ratios(canvas: Canvas, data: dict[str, Any]) -> None:
    """Test ratios of the onboard estimator's aids; 1 is the gate."""
    lines = [(line, as_array(line["t"]), as_array(line["y"]["ratio"])) for line in data["lines"]]
    most = max([0.0, *(float(v.max()) for _, t, y in lines if len(v := within(t, y, canvas.span)))])
    top = min(max(1.15 * most, 1.25), HIGHEST_RATIO)
    for i, (line, t, y) in enumerate(lines):
        colour = palette()[f"e{line['slot']}"]
        canvas.plain(
            line["aid"], colour, *thinned(t, y, canvas.span), line={"dash": PRINT_DASHES[i % len(PRINT_DASHES)]}
        )
        if most > top:
            beyond(canvas, colour, t, y, top)
    canvas.axes["xaxis"] = time_axis(canvas.span)
    canvas.axes["yaxis"] = axis("test ratio, share of the gate", range=[0, top])
    canvas.level("gate", 1.0, palette()["bad"])
    phases(canvas)


def draw_vibration(canvas: Canvas, data: dict[str, Any]) -> None:
    """The autopilot's own level with its limits, or the standard deviation of the logged accelerometer."""
    top = _levels(canvas, data) if "level" in data else _deviations(canvas, data)
    if data["clipped"]:
        marker = {"symbol": "triangle-down", "size": MARKER + 1, "color": palette()["bad"]}
        t = [c[0] for c in data["clipped"]]
        canvas.marker(t, [0.97 * top] * len(t), marker, name="clipped")
    canvas.axes["xaxis"] = time_axis(canvas.span)
    phases(canvas)


def _levels(canvas: Canvas, data: dict[str, Any]) -> float:
    """The level and those percentiles and limits that are in sight; the upper end of the axis."""
    tint, t, y = palette()["e1"], as_array(data["t"]), as_array(data["level"])
    most = max(0.1, float(np.max(within(t, y, canvas.span), initial=0.0)))
    top: float = max([1.15 * most, *(1.1 * v for v in data["limits"][:1] if 1.1 * v < MAX_LIMIT_FACTOR * most)])
    canvas.plain("level", tint, *thinned(t, y, canvas.span))
    for what, v in data["shares"].items():
        if v <= top and what != "worst":
            canvas.level(f"{what} {v:.3g}", v, palette()["mu"], DOT if what == "p50" else PRINT_DASHES[3])
    for i, v in enumerate(data["limits"]):
        if v <= top:
            canvas.level(f"limit {v:g}", v, palette()["bad" if i else "warn"], DASH if i else PRINT_DASHES[4])
    canvas.axes["yaxis"] = axis("vibration, m/s²", range=[0, top], nticks=6)
    return top


def _deviations(canvas: Canvas, data: dict[str, Any]) -> float:
    """The three axes of the logged accelerometer; the upper end of the axis."""
    t, top = as_array(data["t"]), 0.1
    for a, values in data["axes"].items():
        y = as_array(values)
        canvas.plain(a, palette()[f"a{a}"], *thinned(t, y, canvas.span), line={"dash": AXIS_DASHES[a]})
        top = max(top, float(np.max(within(t, y, canvas.span), initial=0.0)))
    canvas.axes["yaxis"] = axis("standard deviation, m/s²", range=[0, 1.08 * top], nticks=6)
    return 1.08 * top


# The compass: its axes against the earth's field, its size against the motors; and spectra.

FIELD_AXES = ("x", "y", "z")
FIELD_PARTS = (("", "measured", "solid"), ("expected_", "expected", DASH), ("corrected_", "corrected", DOT))


def draw_compass(canvas: Canvas, data: dict[str, Any]) -> None:
    """Measured, expected and corrected field in body axes, and its size."""
    t, colours = as_array(data["t"]), palette()
    canvas.height = 72.0 * 4
    parts = [(what, dash, _sized(data["y"], prefix)) for prefix, what, dash in FIELD_PARTS if f"{prefix}x" in data["y"]]
    for i, (name, place) in enumerate(zip((*FIELD_AXES, "size"), domains(4), strict=True)):
        key = axis_key(i)
        colour = colours[f"a{name}"] if i < 3 else colours["mu"]
        for what, dash, columns in parts:
            own = INK if what == "expected" else colour
            x, y = thinned(t, columns[i], canvas.span)
            line = {"color": own, "dash": dash, "width": LINE}
            canvas.key(Key(what, INK, dash))
            canvas.plain(what, own, x, y, yaxis=key, line=line)
        seen = np.concatenate([within(t, columns[i], canvas.span) for _, _, columns in parts])
        low, high = quantile(seen, 0.003), quantile(seen, 0.997)
        pad = max(0.1 * (high - low), 1.0)
        canvas.axes["yaxis" + key[1:]] = axis(f"{name}, µT", domain=place, nticks=5, range=[low - pad, high + pad])
    canvas.axes["xaxis"] = time_axis(canvas.span, "y4")
    phases(canvas)


def _sized(columns: dict[str, Any], prefix: str) -> list[NDArray[np.float64]]:
    """The three axes of a field and its size."""
    axes = [as_array(columns[prefix + a]) for a in FIELD_AXES]
    return [*axes, np.sqrt(sum(a * a for a in axes))]


def draw_interference(canvas: Canvas, data: dict[str, Any]) -> None:
    """The field's size less the earth's against what drives the motors, with the fitted line."""
    x, y = as_array(data["x"]), as_array(data["y"])
    ends = np.array([x.min(), x.max()])
    line = data["line"][0] + data["line"][1] * ends
    canvas.marker(x, y, {"size": 2.5, "color": palette()["ac"], "opacity": 0.5}, name="samples")
    canvas.plain("fitted line", INK, ends, line, line={"width": STRONG})
    both = np.concatenate([y, line])
    low, high = quantile(both, 0.005), quantile(both, 0.995)
    pad = max(0.1 * (high - low), 0.5)
    canvas.axes["xaxis"] = below(data["label"])
    canvas.axes["yaxis"] = axis("field minus the earth’s, µT", range=[low - pad, high + pad], nticks=6)
