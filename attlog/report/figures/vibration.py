"""Vibration: its level over the flight with the firmware's limits, and its spectrum with rotors and notches."""

from __future__ import annotations

import math
from typing import Any

from attlog.present.numbers import counted, duration, number, quantity
from attlog.report.figures.figure import PageFigure, listed
from attlog.result import Trace

AXES = ("x", "y", "z")
DENSITY = {"gyro": "°/s/√Hz", "accelerometer": "m/s²/√Hz"}
FASTEST_HZ = 300.0
"""Multirotors' rotors turn at 40 to 300 times a second; so fast a shaking folds back to rate - 300 Hz and above."""


def spectrum(traces: list[Trace], rotor: list[Trace], notches: list[Trace]) -> PageFigure:
    """Amplitude density of the three axes, gyro or accelerometer to be chosen; rotors, notches and what is folded."""
    keys = [key for key in DENSITY if any(t.key == key for t in traces)]
    own = {t.key: t for t in traces}
    views = [
        {
            "x": listed(own[key].t),
            "axes": {a: listed(own[key].columns[a]) for a in AXES},
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
        data["rotor"] = [bar(low, f, high) for low, f, high in bands(rotor[0])]
        turning = f"{number(float(rotor[0].t[0]), 'Hz')} Hz"
        seen = float(rotor[0].t[0]) < nyquist
        caption += (
            f" Grey: rotors, {turning} and harmonics." if seen else f" Rotors turn at {turning}, beyond half the rate."
        )
    if notches:
        data["notches"] = [bar(*b) | {"key": t.key} for t in notches for b in bands(t)]
        caption += "".join(f" {notch_text(t)}." for t in notches)
    words = "; ".join(f"{key} highest at {peak(own[key])}" for key in keys)
    return PageFigure("spectrum", "spectrum", "Spectrum", caption, 330, data, False, words, keys)


def bands(trace: Trace) -> list[tuple[float, float, float]]:
    """Lower edge, middle, upper edge of each band, Hz."""
    return [
        (float(low), float(f), float(high))
        for low, f, high in zip(trace.columns["low"], trace.t, trace.columns["high"], strict=True)
    ]


def bar(low: float, middle: float, high: float) -> dict[str, float]:
    """A band as the script draws it."""
    return {"low": low, "f": middle, "high": high}


def notch_text(trace: Trace) -> str:
    """The notches that are set, or proposed, in words."""
    middles = ", ".join(number(float(f), "Hz") for f in trace.t)
    return f"{'Green: notch proposed' if trace.key == 'proposed' else 'Blue: notch set'} at {middles} Hz"


def peak(trace: Trace) -> str:
    """Where the axis with the highest line has it, in words."""
    axis = max(AXES, key=lambda a: float(trace.columns[a].max()))
    return f"{quantity(float(trace.t[int(trace.columns[axis].argmax())]), 'Hz')} ({axis})"


def vibration(levels: list[Trace], deviations: list[Trace], clipping: list[Trace]) -> PageFigure:
    """The autopilot's own level of each unit with percentiles and limits, then the logged accelerometer's deviation.

    ``clipping``: what the vehicle counted, else what the logged samples show.
    """
    clipped = marks(clipping[0], "samples") if clipping else [m for t in deviations for m in marks(t, "clipped")]
    views = [view | {"clipped": clipped} for view in [*map(level, levels), *map(deviation, deviations)]]
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


def marks(trace: Trace, column: str) -> list[list[float]]:
    """Times and numbers of clipped samples, where there are any."""
    return [[round(float(t), 1), int(n)] for t, n in zip(trace.t, trace.columns[column], strict=True) if n > 0]


def level(trace: Trace) -> dict[str, Any]:
    """A view of the firmware's level: the worst axis of each second in flight."""
    shares = {name: trace.values[name] for name in ("p50", "p80", "worst")}
    return {"t": listed(trace.t), "level": listed(trace.columns["level"]), "shares": shares, "limits": limits(trace)}


def limits(trace: Trace) -> list[float]:
    """The firmware's limits of a level, m/s^2, as far as there are any."""
    return [trace.values[name] for name in ("limit", "fault") if math.isfinite(trace.values.get(name, math.nan))]


def level_text(trace: Trace) -> str:
    """Percentiles of a level and its limits."""
    v = trace.values
    text = f"p50 {number(v['p50'])}, p80 {number(v['p80'])}, worst second {quantity(v['worst'], 'm/s^2')}"
    return text + (f"; limits {' and '.join(f'{x:g}' for x in limits(trace))}" if limits(trace) else "")


def deviation(trace: Trace) -> dict[str, Any]:
    """A view of the logged accelerometer: its standard deviation over time."""
    return {"t": listed(trace.t), "axes": {a: listed(trace.columns[a]) for a in AXES}}


def deviation_text(trace: Trace) -> str:
    """How far the deviation goes."""
    return "; ".join(f"{a} up to {quantity(float(trace.columns[a].max()), 'm/s^2')}" for a in AXES)


def clipping_text(trace: Trace) -> str:
    """How many samples of the accelerometer were clipped."""
    clipped = int(trace.values.get("samples", 0.0))
    return f"▼ {counted(clipped, 'sample')} at the end of its range." if clipped else "No sample was clipped."
