"""The sensors themselves: spectra, vibration, sizes of gravity and field, gyro bias."""

from __future__ import annotations

from typing import Any

from attlog.present.numbers import counted, duration, quantity
from attlog.report.figures.figure import PageFigure, Rows, listed, reach, reduction_text, series
from attlog.report.pack import Store
from attlog.result import Trace

AXES = ("x", "y", "z")
DENSITY = {"gyro": "°/s/√Hz", "accelerometer": "m/s²/√Hz"}
SIZES = {
    "gravity": ("Size of the acceleration", "m/s²", "gravity at the place", "standing still it shows gravity"),
    "field": ("Size of the magnetic field", "µT", "the earth's field there", "motors and iron change it"),
}


def sensors(by: dict[str, list[Trace]], names: Rows, store: Store) -> list[PageFigure]:
    """Spectrum, vibration, sizes over time with throttle, gyro bias."""
    figures = []
    if by.get("spectrum"):
        figures.append(spectrum(by["spectrum"]))
    if by.get("vibration"):
        figures.append(vibration(by["vibration"][0]))
    for kind in SIZES:
        if by.get(kind):
            figures.append(size(by[kind][0], by.get("throttle", [])))
    if by.get("bias") or by.get("rest_bias"):
        figures.append(bias(by.get("bias", []), by.get("rest_bias", []), names, store))
    return figures


def spectrum(traces: list[Trace]) -> PageFigure:
    """Amplitude density of the three axes; gyro or accelerometer to be chosen."""
    keys = [key for key in DENSITY if any(t.key == key for t in traces)]
    own = {t.key: t for t in traces}
    views = [
        {
            "x": listed(own[key].t),
            "axes": {a: listed(own[key].columns[a]) for a in AXES},
            "unit": DENSITY[key],
            "nyquist": own[key].values["nyquist_hz"],
        }
        for key in keys
    ]
    caption = f"{duration(own[keys[0]].values['seconds'])} of flight (of the whole log without one). "
    caption += "Dashed: half the sampling rate; what shakes faster folds back below it."
    words = "; ".join(f"{key} highest at {peak(own[key])}" for key in keys)
    return PageFigure("spectrum", "spectrum", "Spectrum", caption, 330, {"views": views}, False, words, keys)


def peak(trace: Trace) -> str:
    """Where the axis with the highest line has it, in words."""
    axis = max(AXES, key=lambda a: float(trace.columns[a].max()))
    return f"{quantity(float(trace.t[int(trace.columns[axis].argmax())]), 'Hz')} ({axis})"


def vibration(trace: Trace) -> PageFigure:
    """Standard deviation of the accelerometer over time, and where it was clipped."""
    clipped = int(trace.values.get("samples", 0.0))
    caption = "Standard deviation of the accelerometer within a second or more. "
    caption += f"▼ {counted(clipped, 'sample')} at the end of its range." if clipped else "No sample was clipped."
    data: dict[str, Any] = {"t": listed(trace.t), "axes": {a: listed(trace.columns[a]) for a in AXES}}
    data["clipped"] = [[float(t), int(n)] for t, n in zip(trace.t, trace.columns["clipped"], strict=True) if n > 0]
    highest = "; ".join(f"{a} up to {quantity(float(trace.columns[a].max()), 'm/s^2')}" for a in AXES)
    return PageFigure("vibration", "vibration", "Vibration", caption, 330, data, False, highest)


def size(trace: Trace, throttle: list[Trace]) -> PageFigure:
    """Smallest, mean and largest size over time, what is expected, and the throttle."""
    title, unit, expected, why = SIZES[trace.figure]
    caption = f"Line: mean, band: smallest to largest; {why}."
    data: dict[str, Any] = {"t": listed(trace.t), "unit": unit}
    data |= {c: listed(trace.columns[c]) for c in ("low", "mean", "high")}
    if "expected" in trace.values:
        data["expected"] = trace.values["expected"]
        caption += f" Dashed: {expected}, {trace.values['expected']:.1f} {unit}."
    if throttle:
        data["throttle"] = [listed(throttle[0].t), listed(throttle[0].columns["throttle"])]
        caption += " Grey: throttle."
    low, high = float(trace.columns["low"].min()), float(trace.columns["high"].max())
    return PageFigure(trace.figure, "size", title, caption, 330, data, False, f"{low:.1f} to {high:.1f} {unit}")


def bias(found: list[Trace], rests: list[Trace], names: Rows, store: Store) -> PageFigure:
    """Gyro bias that the filters found, beside what the gyro shows at rest."""
    drawn, ratio = series(found, AXES, names, store, 1e-4)
    caption = "Subtracted from the logged gyro. Filters without a bias state are not drawn. "
    if any(t.row == "onboard" for t in found):
        caption += f"{names[names.index('onboard')]}: what the autopilot's own estimator logged. "
    data: dict[str, Any] = {"series": drawn}
    if rests:
        data["rests"] = {"t": listed(rests[0].t)} | {a: listed(rests[0].columns[a]) for a in AXES}
        caption += "● what the gyro shows at rest. "
    title = "Gyro bias that the filters found" if found else "Gyro bias at rest"
    return PageFigure(
        "bias", "bias", title, caption + reduction_text(ratio), 430, data, True, reach(found, names, "deg/s")
    )
