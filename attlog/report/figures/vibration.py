"""Figures of vibration: level over the flight with firmware limits, and spectrum."""

from __future__ import annotations

import math

import numpy as np

from attlog.report.figures.figure import FigureSource, PageFigure, View, decades
from attlog.report.figures.flight import SENSED
from attlog.result import Trace
from attlog.words.numbers import counted, duration, number, quantity

AXES = ("x", "y", "z")
DENSITY = {"gyro": "°/s/√Hz", "accelerometer": "m/s²/√Hz"}
DENSITY_UNIT = {"gyro": "deg/s/sqrt(Hz)", "accelerometer": "m/s^2/sqrt(Hz)"}
# Highest rotor rate. Rotors of multirotors turn at 40 to 300 Hz; such vibration aliases to rate - 300 Hz and above.
FASTEST_HZ = 300.0
# Decades shown below the highest line of a spectrum.
MAX_DECADES = 5.0
# Limits beyond this multiple of the highest level are not shown.
MAX_LIMIT_FACTOR = 6.0


def vibration(source: FigureSource) -> PageFigure | None:
    """Draw the autopilot's vibration level of each IMU with limits, and logged deviations."""
    levels, deviations, clipping = (source.traces(k) for k in ("levels", "vibration", "clipping"))
    if not levels and not deviations:
        return None
    views = [level_view(source, trace) for trace in levels] + [deviation_view(source, t) for t in deviations]
    clipped = (
        clipping_marks(clipping[0], "samples")
        if clipping
        else [mark for trace in deviations for mark in clipping_marks(trace, "clipped")]
    )
    for view in views if clipped else ():
        meta = {
            "quantity": "clipped samples",
            "unit": "1",
            "edge": 0.97,
            "free": True,
            "value": [n for _, n in clipped],
        }
        marker = {"symbol": "triangle-down", "size": 9, "color": "bad"}
        view.markers("clipped", [t for t, _ in clipped], [0.0] * len(clipped), marker, meta=meta, hoverinfo="skip")
    names = [f"level by {t.key}" for t in levels] + ["1σ of the logged accelerometer" for _ in deviations]
    words = [f"{t.key}: {level_text(t)}" for t in levels] + [deviation_text(t) for t in deviations]
    caption = [f"The autopilot's own level in flight: {level_text(t)}." for t in levels[:1]]
    if not levels:
        caption = ["Standard deviation of the accelerometer within a second or more."]
    if clipping:
        caption.append(f"▼ {counted(int(clipping[0].values['samples']), 'sample')} clipped ({clipping[0].key}).")
    else:
        caption += [clipping_text(t) for t in deviations]
    data = {"views": [view.as_data() for view in views], "timed": True, "phases": "plain", "labels": "head"}
    text = " ".join(caption)
    said = "; ".join(words)
    return PageFigure("vibration", "plot", "Vibration, m/s²", text, 330, data | {"table": SENSED}, False, said, names)


def level_view(source: FigureSource, trace: Trace) -> View:
    """Draw the firmware's level with the percentiles and limits that are in range."""
    view, y = source.view(), np.asarray(trace.columns["level"], np.float64)
    most = max(0.1, float(np.max(y[np.isfinite(y)], initial=0.0)))
    limits = level_limits(trace)
    include = [v for v in limits[:1] if 1.1 * v < MAX_LIMIT_FACTOR * most]
    top = max([1.15 * most, *(1.1 * v for v in include)])
    quantity_name = f"level by {trace.key}"
    meta = {"time": True, "quantity": quantity_name}
    view.line("level", "e1", trace.t, y, unit="m/s^2", width=1.6, meta=meta)
    for name in ("p50", "p80"):
        if trace.values[name] <= top:
            view.level(trace.values[name], "mu", f"{name} {trace.values[name]:.3g}", dash="dot", right=True)
            view.notes[-1]["yanchor"] = "top" if name == "p50" else "bottom"
    for i, v in enumerate(limits):
        if v <= top:
            view.level(v, "bad" if i else "warn", f"limit {v:g}")
    view.axis("x", "time, s")
    view.axis("y", "vibration, m/s²", fit={"floor": 0.0, "pad": 0.15, "include": [v / 1.045 for v in include]})
    return view


def deviation_view(source: FigureSource, trace: Trace) -> View:
    """Draw the standard deviation of the logged accelerometer by axis."""
    view = source.view()
    for a in AXES:
        meta = {"time": True, "quantity": f"standard deviation of {a}"}
        view.line(a, f"a{a}", trace.t, trace.columns[a], unit="m/s^2", meta=meta)
    view.axis("x", "time, s")
    view.axis("y", "standard deviation, m/s²", fit={"floor": 0.0, "pad": 0.08, "least": 0.1})
    return view


def level_limits(trace: Trace) -> list[float]:
    """Return the firmware's limits of a level, m/s^2."""
    return [trace.values[name] for name in ("limit", "fault") if math.isfinite(trace.values.get(name, math.nan))]


def level_text(trace: Trace) -> str:
    """Describe percentiles of a level and its limits."""
    v = trace.values
    text = f"p50 {number(v['p50'])}, p80 {number(v['p80'])}, worst second {quantity(v['worst'], 'm/s^2')}"
    limits = level_limits(trace)
    return text + (f"; limits {' and '.join(f'{x:g}' for x in limits)}" if limits else "")


def deviation_text(trace: Trace) -> str:
    """Describe the largest deviation of each axis."""
    return "; ".join(f"{a} up to {quantity(float(trace.columns[a].max()), 'm/s^2')}" for a in AXES)


def clipping_marks(trace: Trace, column: str) -> list[tuple[float, int]]:
    """Return times and numbers of clipped samples."""
    return [(round(float(t), 1), int(n)) for t, n in zip(trace.t, trace.columns[column], strict=True) if n > 0]


def clipping_text(trace: Trace) -> str:
    """Describe how many accelerometer samples were clipped."""
    clipped = int(trace.values.get("samples", 0.0))
    return f"▼ {counted(clipped, 'sample')} at the end of its range." if clipped else "No sample was clipped."


def spectrum(source: FigureSource) -> PageFigure | None:
    """Draw the amplitude density of three axes with rotors, notches and aliased frequencies."""
    own = {t.key: t for t in source.traces("spectrum")}
    keys = [key for key in DENSITY if key in own]
    if not keys:
        return None
    rotor, notches = source.traces("rotor")[:1], source.traces("notches")
    views = [spectrum_view(source, own[key], rotor, notches).as_data() for key in keys]
    nyquist = own[keys[0]].values["nyquist_hz"]
    caption = f"{duration(own[keys[0]].values['seconds'])} of flight (of the whole log without one)."
    if folded_from(nyquist) < nyquist:
        caption += f" Hatched: shaking between {nyquist:.0f} and {FASTEST_HZ:.0f} Hz would show here, folded."
    for trace in rotor:
        turning = f"{number(float(trace.t[0]), 'Hz')} Hz"
        seen = float(trace.t[0]) < nyquist
        caption += (
            f" Grey: rotors, {turning} and harmonics." if seen else f" Rotors turn at {turning}, beyond half the rate."
        )
    caption += "".join(f" {notch_text(t)}." for t in notches)
    words = "; ".join(f"{key} highest at {peak_words(own[key])}" for key in keys)
    data = {"views": views, "labels": "head", "at": " Hz", "table": ["frequency_hz", "quantity", "value", "unit"]}
    return PageFigure("spectrum", "plot", "Spectrum", caption, 330, data, False, words, keys)


def spectrum_view(source: FigureSource, trace: Trace, rotor: list[Trace], notches: list[Trace]) -> View:
    """Draw one sensor's spectrum."""
    view, x = source.view(), np.asarray(trace.t, np.float64)
    nyquist = trace.values["nyquist_hz"]
    for a in AXES:
        meta = {"quantity": f"{trace.key} {a}", "digits": 4, "log": True, "say": f" {DENSITY[trace.key]}"}
        view.line(a, f"a{a}", x, trace.columns[a], unit=DENSITY_UNIT[trace.key], meta=meta)
    every = np.concatenate([np.asarray(trace.columns[a], np.float64) for a in AXES])
    good = np.sort(every[np.isfinite(every) & (every > 0)])
    high = float(np.log10(good[-1])) if len(good) else 0.0
    low = max(float(np.log10(good[len(good) // 100])) if len(good) else -1.0, high - MAX_DECADES)
    reach = [low - 0.1, high + 0.3]
    ends = [float(np.log10(x[0])), float(np.log10(1.12 * nyquist))]
    view.axis("x", "frequency, Hz", type="log", range=ends, **decades(x))
    view.axis("y", f"{trace.key}, {DENSITY[trace.key]}", type="log", range=reach, **decades(every, 6))
    boxes = [(band, "e9") for t in rotor for band in frequency_bands(t)]
    boxes += [(band, "e3" if t.key == "proposed" else "e1") for t in notches for band in frequency_bands(t)]
    for (start, _, end), colour in boxes:
        line = {"color": f"{colour}/0.6", "width": 1}
        view.span(start, max(end, 1.01 * start), f"{colour}/0.18", line=line)
    for i, (_, middle, _) in enumerate(frequency_bands(rotor[0]) if rotor else ()):
        if middle < nyquist:
            view.note(f"{i + 1}×", x=float(np.log10(middle)), y=0.86)
    folded = folded_from(nyquist)
    if folded < nyquist:
        hatched = {"shape": "/", "fgcolor": "bad", "size": 6, "solidity": 0.25, "fillmode": "overlay"}
        x_ends = [max(folded, float(x[0])), nyquist]
        low_edge, high_edge = 10.0 ** (reach[1] - 0.05 * (reach[1] - reach[0])), 10.0 ** reach[1]
        view.band("folded", "bad", x_ends, [low_edge] * 2, [high_edge] * 2, meta={"keyless": True})
        view.traces[-1] |= {"fillcolor": "rgba(0,0,0,0)", "fillpattern": hatched}
    view.upright(nyquist, "bad", "dash")
    view.note(f"half of {2 * nyquist:.0f} Hz", x=float(np.log10(nyquist)), xanchor="right")
    return view


def folded_from(nyquist: float) -> float:
    """Return the lowest frequency to which faster vibration aliases, Hz."""
    return max(2.0 * nyquist - FASTEST_HZ, 0.0)


def frequency_bands(trace: Trace) -> list[tuple[float, float, float]]:
    """Return lower edge, middle and upper edge of each band, Hz."""
    return [
        (float(low), float(f), float(high))
        for low, f, high in zip(trace.columns["low"], trace.t, trace.columns["high"], strict=True)
    ]


def notch_text(trace: Trace) -> str:
    """Describe the notches that are set, or proposed."""
    middles = ", ".join(number(float(f), "Hz") for f in trace.t)
    return f"{'Green: notch proposed' if trace.key == 'proposed' else 'Blue: notch set'} at {middles} Hz"


def peak_words(trace: Trace) -> str:
    """Describe the peak of the axis with the highest line."""
    axis = max(AXES, key=lambda a: float(trace.columns[a].max()))
    return f"{quantity(float(trace.t[int(trace.columns[axis].argmax())]), 'Hz')} ({axis})"
