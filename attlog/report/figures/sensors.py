"""The sensors themselves: compass, vibration, what the onboard estimator rejects, gravity, gyro bias."""

from __future__ import annotations

from typing import Any

from attlog.report.figures.compass import axes, interference
from attlog.report.figures.figure import PageFigure, Rows, listed, reach, reduction_text, series
from attlog.report.figures.ratios import ratios
from attlog.report.figures.vibration import spectrum, vibration
from attlog.report.pack import Store
from attlog.result import Result, Trace

AXES = ("x", "y", "z")
SIZES = {
    "gravity": ("Size of the acceleration", "m/s²", "gravity at the place", "standing still it shows gravity"),
    "field": ("Size of the magnetic field", "µT", "the earth's field there", "motors and iron change it"),
}


def sensors(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[PageFigure]:
    """In the order of the questions. The field's size alone is drawn where nothing tells its direction."""
    figures = []
    if by.get("compass"):
        figures.append(axes(by["compass"], store, result))
    elif by.get("field"):
        figures.append(size(by["field"][0], by.get("throttle", [])))
    if by.get("interference"):
        figures.append(interference(by["interference"][0]))
    if by.get("vibration") or by.get("levels"):
        figures.append(vibration(by.get("levels", []), by.get("vibration", []), by.get("clipping", [])))
    if by.get("spectrum"):
        figures.append(spectrum(by["spectrum"], by.get("rotor", []), by.get("notches", [])))
    if by.get("gravity"):
        figures.append(size(by["gravity"][0], by.get("throttle", [])))
    if by.get("ratios"):
        figures.append(ratios(by["ratios"], store))
    if by.get("bias") or by.get("rest_bias"):
        figures.append(bias(by.get("bias", []), by.get("rest_bias", []), names, store))
    return figures


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
