"""Vibration: its level over the flight with the firmware's limits, and its spectrum with rotors and notches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.report.figures.canvas import Canvas, Key, PageFigure, as_array, json_numbers
from attlog.report.figures.panels import decades
from attlog.report.figures.style import AXIS_DASHES, AXIS_LINE, DASH, axis, below, faded, palette
from attlog.result import Trace
from attlog.words.numbers import counted, duration, number, quantity

AXES = ("x", "y", "z")
DENSITY = {"gyro": "°/s/√Hz", "accelerometer": "m/s²/√Hz"}
FASTEST_HZ = 300.0
"""Multirotors' rotors turn at 40 to 300 times a second; so fast a shaking folds back to rate - 300 Hz and above."""


def spectrum_figure(traces: list[Trace], rotor: list[Trace], notches: list[Trace]) -> PageFigure:
    """Amplitude density of the three axes, gyro or accelerometer to be chosen; rotors, notches and what is folded."""
    keys = [key for key in DENSITY if any(t.key == key for t in traces)]
    own = {t.key: t for t in traces}
    views = [
        {
            "x": json_numbers(own[key].t),
            "axes": {a: json_numbers(own[key].columns[a]) for a in AXES},
            "unit": DENSITY[key],
            "nyquist": own[key].values["nyquist_hz"],
            "folded": max(2.0 * own[key].values["nyquist_hz"] - FASTEST_HZ, 0.0),
        }
        for key in keys
    ]
    data: dict[str, Any] = {"views": views}
    caption = f"{duration(own[keys[0]].values['seconds'])} of flight (of the whole log without one)."
    nyquist = own[keys[0]].values["nyquist_hz"]
    if 2.0 * nyquist - FASTEST_HZ < nyquist:
        caption += f" Hatched: shaking between {nyquist:.0f} and {FASTEST_HZ:.0f} Hz would show here, folded."
    if rotor:
        data["rotor"] = [frequency_band(low, f, high) for low, f, high in frequency_bands(rotor[0])]
        turning = f"{number(float(rotor[0].t[0]), 'Hz')} Hz"
        seen = float(rotor[0].t[0]) < nyquist
        caption += (
            f" Grey: rotors, {turning} and harmonics." if seen else f" Rotors turn at {turning}, beyond half the rate."
        )
    if notches:
        data["notches"] = [frequency_band(*b) | {"key": t.key} for t in notches for b in frequency_bands(t)]
        caption += "".join(f" {notch_text(t)}." for t in notches)
    words = "; ".join(f"{key} highest at {peak_words(own[key])}" for key in keys)
    return PageFigure("spectrum", "spectrum", "Spectrum", caption, 330, data, False, words, keys)


def frequency_bands(trace: Trace) -> list[tuple[float, float, float]]:
    """Lower edge, middle, upper edge of each band, Hz."""
    return [
        (float(low), float(f), float(high))
        for low, f, high in zip(trace.columns["low"], trace.t, trace.columns["high"], strict=True)
    ]


def frequency_band(low: float, middle: float, high: float) -> dict[str, float]:
    """A band as the script draws it."""
    return {"low": low, "f": middle, "high": high}


def notch_text(trace: Trace) -> str:
    """The notches that are set, or proposed, in words."""
    middles = ", ".join(number(float(f), "Hz") for f in trace.t)
    return f"{'Green: notch proposed' if trace.key == 'proposed' else 'Blue: notch set'} at {middles} Hz"


def peak_words(trace: Trace) -> str:
    """Where the axis with the highest line has it, in words."""
    axis = max(AXES, key=lambda a: float(trace.columns[a].max()))
    return f"{quantity(float(trace.t[int(trace.columns[axis].argmax())]), 'Hz')} ({axis})"


def vibration_figure(levels: list[Trace], deviations: list[Trace], clipping: list[Trace]) -> PageFigure:
    """The autopilot's own level of each unit with percentiles and limits, then the logged accelerometer's deviation.

    ``clipping``: what the vehicle counted, else what the logged samples show.
    """
    clipped = (
        clipping_marks(clipping[0], "samples")
        if clipping
        else [m for t in deviations for m in clipping_marks(t, "clipped")]
    )
    views = [view | {"clipped": clipped} for view in [*map(level_view, levels), *map(deviation_view, deviations)]]
    called = [f"level by {t.key}" for t in levels] + ["1σ of the logged accelerometer" for _ in deviations]
    words = [f"{t.key}: {level_text(t)}" for t in levels] + [deviation_text(t) for t in deviations]
    caption = [f"The autopilot's own level in flight: {level_text(t)}." for t in levels[:1]]
    if not levels:
        caption = ["Standard deviation of the accelerometer within a second or more."]
    if clipping:
        caption.append(f"▼ {counted(int(clipping[0].values['samples']), 'sample')} clipped ({clipping[0].key}).")
    else:
        caption += [clipping_text(t) for t in deviations]
    title = "Vibration, m/s²"
    return PageFigure(
        "vibration", "vibration", title, " ".join(caption), 330, {"views": views}, False, "; ".join(words), called
    )


def clipping_marks(trace: Trace, column: str) -> list[list[float]]:
    """Times and numbers of clipped samples, where there are any."""
    return [[round(float(t), 1), int(n)] for t, n in zip(trace.t, trace.columns[column], strict=True) if n > 0]


def level_view(trace: Trace) -> dict[str, Any]:
    """A view of the firmware's level: the worst axis of each second in flight."""
    shares = {name: trace.values[name] for name in ("p50", "p80", "worst")}
    return {
        "t": json_numbers(trace.t),
        "level": json_numbers(trace.columns["level"]),
        "shares": shares,
        "limits": level_limits(trace),
    }


def level_limits(trace: Trace) -> list[float]:
    """The firmware's limits of a level, m/s^2, as far as there are any."""
    return [trace.values[name] for name in ("limit", "fault") if math.isfinite(trace.values.get(name, math.nan))]


def level_text(trace: Trace) -> str:
    """Percentiles of a level and its limits."""
    v = trace.values
    text = f"p50 {number(v['p50'])}, p80 {number(v['p80'])}, worst second {quantity(v['worst'], 'm/s^2')}"
    return text + (f"; limits {' and '.join(f'{x:g}' for x in level_limits(trace))}" if level_limits(trace) else "")


def deviation_view(trace: Trace) -> dict[str, Any]:
    """A view of the logged accelerometer: its standard deviation over time."""
    return {"t": json_numbers(trace.t), "axes": {a: json_numbers(trace.columns[a]) for a in AXES}}


def deviation_text(trace: Trace) -> str:
    """How far the deviation goes."""
    return "; ".join(f"{a} up to {quantity(float(trace.columns[a].max()), 'm/s^2')}" for a in AXES)


def clipping_text(trace: Trace) -> str:
    """How many samples of the accelerometer were clipped."""
    clipped = int(trace.values.get("samples", 0.0))
    return f"▼ {counted(clipped, 'sample')} at the end of its range." if clipped else "No sample was clipped."


# The spectrum of vibration with rotors, notches and what faster shaking folds back to.

DENSITY_WORDS = {"°/s/√Hz": "gyro", "m/s²/√Hz": "accelerometer"}
MAX_DECADES = 5.0
"""Decades below the highest line that are shown."""


def draw_spectrum(canvas: Canvas, data: dict[str, Any]) -> None:
    """Amplitude density of the three axes over frequency."""
    x, colours = as_array(data["x"]), palette()
    lines = {a: as_array(y) for a, y in data["axes"].items()}
    for a, y in lines.items():
        canvas.plain(a, colours[f"a{a}"], x, y, line={"dash": AXIS_DASHES[a]})
    every = np.concatenate(list(lines.values()))
    good = np.sort(every[np.isfinite(every) & (every > 0)])
    high = float(np.log10(good[-1])) if len(good) else 0.0
    low = max(float(np.log10(good[len(good) // 100])) if len(good) else -1.0, high - MAX_DECADES)
    reach = [low - 0.1, high + 0.3]
    canvas.axes["yaxis"] = axis(
        f"{DENSITY_WORDS.get(data['unit'], 'density')}, {data['unit']}", type="log", range=reach, **decades(every, 6)
    )
    ends = [float(np.log10(x[0])), float(np.log10(1.12 * data["nyquist"]))]
    canvas.axes["xaxis"] = below("frequency, Hz", type="log", range=ends, **decades(x, 5))
    _bands(canvas, data, reach)
    canvas.upright(data["nyquist"], colours["bad"], DASH)
    canvas.key(Key("half the rate", colours["bad"], DASH))


def _bands(canvas: Canvas, data: dict[str, Any], reach: list[float]) -> None:
    """Rotors grey, notches that are set blue, proposed ones green, folded frequencies hatched at the top."""
    colours = palette()
    boxes = [(b, "rotors", colours["e9"]) for b in data.get("rotor", [])]
    for b in data.get("notches", []):
        proposed = b["key"] == "proposed"
        boxes.append((b, "notch proposed" if proposed else "notch set", colours["e3" if proposed else "e1"]))
    for b, name, colour in boxes:
        canvas.key(Key(name, colour, fill=True))
        line = {"color": faded(colour, 0.6), "width": AXIS_LINE}
        canvas.band(b["low"], max(b["high"], 1.01 * b["low"]), faded(colour, 0.18), line=line)
    for i, b in enumerate(data.get("rotor", [])):
        if b["f"] < data["nyquist"]:
            canvas.note(float(np.log10(b["f"])), f"{i + 1}×")
    if data["folded"] < data["nyquist"]:
        low, high = reach
        x = [max(data["folded"], float(data["x"][0])), data["nyquist"]]
        hatched = {"shape": "/", "fgcolor": colours["bad"], "size": 5, "solidity": 0.25, "fillmode": "overlay"}
        canvas.edge(x, [10.0 ** (high - 0.05 * (high - low))] * 2)
        canvas.edge(x, [10.0**high] * 2, fill="tonexty", fillcolor="rgba(0,0,0,0)", fillpattern=hatched)
