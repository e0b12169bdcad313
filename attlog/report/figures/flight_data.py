"""Figures of flight data: heights, speeds, rates, outputs, sticks, battery, GNSS reception, load, temperature.

A figure is a row of FIGURES: panels of lines by label, without those that the log has no line for.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from attlog.flight.panels import PANELS, RATE_PANELS
from attlog.report.figures.figure import FigureSource, PageFigure, View, axis_key, panel_domain, sampling_text
from attlog.report.figures.flight import SENSED, before_crash, heading_cut
from attlog.result import Trace
from attlog.words.numbers import counted, quantity, unit_sign

# Height of a panel, and of what surrounds all of them, px.
PANEL_PX, AROUND_PX = 128, 66
# Height of a printed panel, px: its title has room.
PRINTED_PX = 74.0
# Colour and dash of labels with a meaning of their own; the others take the palette in their order.
FIXED = {
    "onboard": ("e0", "solid"),
    "set-point": ("mu", "dash"),
    "TECS set-point": ("mu", "dash"),
    "air set-point": ("mu", "dot"),
    "gyro": ("e1", "solid"),
    **{axis: (f"a{axis}", "solid") for axis in "xyz"},
}
PALETTE = 8
# Number of a motor, rotor, speed controller or output in its label.
NUMBER = re.compile(r"\d+")
# Panels whose values after a crash set no range.
UPSET = {"height", "climb", "speed", "volts", "acceleration", *RATE_PANELS}
# Logged samples for each stored one from which the caption says so.
LEAST_THINNED = 1.2
# Share of the values that leave the figure at the top: an accuracy of kilometres before the first fix.
BEFORE_FIX = 0.02
# The same of an acceleration: a blow on landing.
STRAY = 0.0005


class Axis(NamedTuple):
    """Vertical axis of a panel: title without its unit, smallest range, step of the stored values."""

    title: str
    least: float
    step: float
    fit: tuple[tuple[str, float], ...] = ()


class DataFigure(NamedTuple):
    """Figure of flight data: its panels and the sentences below it."""

    id: str
    title: str
    panels: tuple[str, ...]
    caption: str = ""


FROM_ZERO = (("floor", 0.0), ("pad", 0.1))
# Lower end of the motors' axis. A stopped motor rests at one level below it most of that time; one that turns in
# reverse takes many, in whole per cent, and none of them for half of it.
STOPPED_PERCENT, MIN_REVERSE_LEVELS = -25.0, 8
AXES: dict[str, Axis] = {
    "height": Axis("height", 2.0, 0.01),
    "climb": Axis("climb", 1.0, 0.005),
    "speed": Axis("speed", 1.0, 0.005, FROM_ZERO),
    "roll_rate": Axis("roll", 10.0, 0.02),
    "pitch_rate": Axis("pitch", 10.0, 0.02),
    "yaw_rate": Axis("yaw", 10.0, 0.02),
    "roll": Axis("roll", 4.0, 0.02),
    "pitch": Axis("pitch", 4.0, 0.02),
    "heading": Axis("heading", 10.0, 0.02),
    "acceleration": Axis("acceleration", 4.0, 0.01, (("share", STRAY), ("pad", 0.1))),
    "motors": Axis("motors", 10.0, 0.02, (("floor", STOPPED_PERCENT), ("pad", 0.06))),
    "servos": Axis("servos", 10.0, 0.02),
    "outputs": Axis("outputs", 100.0, 0.5),
    "commands": Axis("commands", 1.0, 0.01),
    "rpm": Axis("rotors", 100.0, 1.0),
    "esc_current": Axis("ESC", 1.0, 0.01),
    "sticks": Axis("sticks", 20.0, 0.05),
    "stick_pulses": Axis("sticks", 100.0, 0.5),
    "channels": Axis("channels", 100.0, 0.5),
    "volts": Axis("voltage", 0.5, 0.002),
    "amperes": Axis("current", 1.0, 0.01),
    "used": Axis("used", 10.0, 0.5),
    "remaining": Axis("remaining", 5.0, 0.05),
    "rails": Axis("rails", 0.3, 0.001),
    "satellites": Axis("satellites", 4.0, 1.0, FROM_ZERO),
    "fix": Axis("fix", 4.0, 1.0, FROM_ZERO),
    "accuracy": Axis("accuracy", 2.0, 0.01, (("share", BEFORE_FIX), ("pad", 0.1))),
    "speed_accuracy": Axis("speed ±", 0.5, 0.005, (("share", BEFORE_FIX), ("pad", 0.1))),
    "dilution": Axis("dilution", 1.0, 0.01, FROM_ZERO),
    "jamming": Axis("jamming", 20.0, 1.0, FROM_ZERO),
    "load": Axis("load", 10.0, 0.05, FROM_ZERO),
    "loop": Axis("longest loop", 1.0, 0.01, FROM_ZERO),
    "slow_loops": Axis("slow loops", 2.0, 1.0, FROM_ZERO),
    "dropouts": Axis("dropouts", 2.0, 1.0, FROM_ZERO),
    "link": Axis("radio", 20.0, 1.0, FROM_ZERO),
    "temperature": Axis("temperature", 4.0, 0.02),
}
FIGURES = (
    DataFigure(
        "heights",
        "Height and vertical speed",
        ("height", "climb"),
        "Each height less its own before take-off; a rangefinder measures from the ground below. Climbing is positive.",
    ),
    DataFigure("speeds", "Speed", ("speed",)),
    DataFigure("headings", "Heading", ("heading",)),
    DataFigure("rates", "Body rates", RATE_PANELS, "Right wing down, nose up and nose right are positive."),
    DataFigure(
        "acceleration",
        "Acceleration",
        ("acceleration",),
        "Specific force in body axes: x forward, y right, z down, −9.8 at rest.",
    ),
    DataFigure("motors", "Motor and servo outputs", ("motors", "servos", "outputs", "commands", "rpm", "esc_current")),
    DataFigure("sticks", "Sticks and switches", ("sticks", "stick_pulses", "channels")),
    DataFigure("battery", "Battery and supply", ("volts", "amperes", "used", "remaining", "rails")),
    DataFigure(
        "reception",
        "GNSS reception",
        ("satellites", "accuracy", "speed_accuracy", "dilution", "fix", "jamming"),
        "Accuracy as the receiver estimates it. Fix: 3 in three dimensions, 4 with corrections, 5 and 6 RTK.",
    ),
    DataFigure("load", "Load of processor, logger and radio", ("load", "loop", "slow_loops", "dropouts", "link")),
    DataFigure("temperature", "Temperature", ("temperature",)),
)
# Attitude of a log in which no filter runs.
ONBOARD = DataFigure("attitude", "Attitude", ("roll", "pitch", "heading"))
RANGE_TEXT = (
    "0 % and 100 % are the ends of the range that the parameters give a motor in flight; a stopped motor lies at 0 % "
    "or below."
)
REVERSE_TEXT = "Below 0 % a motor turns in reverse; 100 % is its greatest output."
# What a line is, by its label.
LABEL_TEXTS = {
    "course": "Course: direction of motion over ground; a copter may fly sideways.",
    "GNSS motion": "GNSS motion: heading without a compass.",
}


def figure_of(figure: DataFigure, source: FigureSource) -> PageFigure | None:
    """Draw the panels of a figure that the log has lines for."""
    lines = [trace for trace in source.traces("data") if trace.key in figure.panels]
    panels = [key for key in figure.panels if any(trace.key == key for trace in lines)]
    if not panels:
        return None
    view, styles = source.view(), _styles(figure, lines)
    for i, key in enumerate(panels):
        _draw_panel(view, source, i, key, [trace for trace in lines if trace.key == key], styles)
        view.axes[f"{axis_key(i)[0]}axis{axis_key(i)[1:]}"]["domain"] = panel_domain(i, len(panels))
    view.axis("x", "time, s", anchor=axis_key(len(panels) - 1))
    data: dict[str, Any] = {"views": [view.as_data()], "timed": True, "phases": "plain", "alarms": True}
    data |= {"labels": "panels", "lazy": True, "size": PRINTED_PX * max(len(panels), 1.5), "table": SENSED}
    thinned = [trace for trace in lines if trace.ratio > LEAST_THINNED]
    said = sampling_text(thinned) if thinned else ""
    explained = [text for label, text in LABEL_TEXTS.items() if any(label in trace.columns for trace in lines)]
    clipped = source.traces("clipping") if "acceleration" in panels else []
    marked = [f"▼ {counted(int(c.values['samples']), 'sample')} clipped ({c.key})." for c in clipped]
    caption = " ".join(filter(None, [figure.caption, *explained, _range_text(lines), *marked, said]))
    height = AROUND_PX + PANEL_PX * len(panels) + (60 if len(panels) == 1 else 0)
    return PageFigure(figure.id, "plot", figure.title, caption, height, data, True, _words(panels, lines))


def onboard_attitude(source: FigureSource) -> PageFigure | None:
    """Draw the onboard attitude of a log in which no filter runs, beside its set-point."""
    alone = any(trace.key == "roll" for trace in source.traces("data"))
    return figure_of(ONBOARD, source) if alone else None


# The builders of all figures, in the order of the page.
BUILDERS: tuple[Callable[[FigureSource], PageFigure | None], ...] = tuple(partial(figure_of, one) for one in FIGURES)


def _draw_panel(
    view: View, source: FigureSource, i: int, key: str, lines: list[Trace], styles: dict[str, tuple[str, str]]
) -> None:
    """Draw the lines of a panel, set-points at the bottom."""
    axis, unit = AXES[key], PANELS[key].unit
    named = [(label, trace, y) for trace in lines for label, y in trace.columns.items()]
    cut = heading_cut([Trace("", "", t.t, {"heading": y}) for _, t, y in named]) if key == "heading" else None
    digits = int(np.clip(np.ceil(-np.log10(axis.step)), 0, 3))
    fit: dict[str, Any] = {"least": axis.least, "pad": 0.08} | dict(axis.fit)
    fit |= before_crash(source) if key in UPSET else {}
    if key == "motors":
        fit["include"] = [100.0]
        if _reverses(lines):
            del fit["floor"]
        for limit in (0.0, 100.0):
            silent = {"time": True, "silent": True, "keyless": True}
            ends = np.array(source.marks["range"])
            view.line("", "edge", ends, np.full(2, limit), dash="dash", yaxis=axis_key(i), meta=silent)
    for label, trace, y in sorted(named, key=lambda one: "set-point" not in one[0]):
        colour, dash = styles[label]
        meta: dict[str, Any] = {"time": True, "step": axis.step, "digits": digits, "quantity": f"{axis.title} {label}"}
        if "share" in fit:
            meta["beyond"] = True
        if cut is not None:
            y = y - 360.0 * np.floor((y - cut) / 360.0)
            meta |= {"wraps": True, "cut": cut}
        if key == "roll":
            meta["wraps"] = True
        view.line(label, colour, trace.t, y, unit=unit, dash=dash, yaxis=axis_key(i), meta=meta)
    sign = unit_sign(unit)
    view.axis(axis_key(i), f"{axis.title}, {sign}" if sign else axis.title, nticks=5, fit=fit, zeroline=False)
    if cut is not None:
        view.axes[f"{axis_key(i)[0]}axis{axis_key(i)[1:]}"]["heading"] = True
    if key == "acceleration":
        clipping_marks(view, source, axis_key(i))


def clipping_marks(view: View, source: FigureSource, key: str) -> None:
    """Mark the seconds with clipped samples at the top of a panel."""
    for trace in source.traces("clipping"):
        count = [int(n) for n in trace.columns["samples"]]
        marker = {"symbol": "triangle-down", "size": 9, "color": "bad"}
        meta = {"quantity": "clipped samples", "unit": "1", "edge": 0.97, "free": True, "value": count}
        times = [round(float(t), 1) for t in trace.t]
        view.markers("clipped", times, [0.0] * len(times), marker, meta=meta, yaxis=key, hoverinfo="skip")


def _reverses(lines: list[Trace]) -> bool:
    """Return whether a motor turns in reverse."""
    low = [np.round(y[y < STOPPED_PERCENT]) for trace in lines for y in trace.columns.values()]
    counts = [np.unique(levels, return_counts=True)[1] for levels in low]
    return any(len(n) >= MIN_REVERSE_LEVELS and 2 * n.max() < n.sum() for n in counts)


def _range_text(lines: list[Trace]) -> str:
    """Return what 0 and 100 % of a motor are, empty without motors."""
    motors = [trace for trace in lines if trace.key == "motors"]
    return "" if not motors else REVERSE_TEXT if _reverses(motors) else RANGE_TEXT


def _styles(figure: DataFigure, lines: list[Trace]) -> dict[str, tuple[str, str]]:
    """Return colour and dash of each label, equal in all panels of a figure; a motor has that of its output."""
    labels = [label for key in figure.panels for trace in lines if trace.key == key for label in trace.columns]
    free = [label for label in dict.fromkeys(labels) if label not in FIXED]
    places = {label: k for k, label in enumerate(free)}
    if figure.id == "motors":
        places = {label: int(NUMBER.findall(label)[0]) - 1 if NUMBER.search(label) else 0 for label in free}
    return FIXED | {label: (f"e{1 + k % PALETTE}", "solid" if k < PALETTE else "dash") for label, k in places.items()}


def _words(panels: list[str], lines: list[Trace]) -> str:
    """Describe the lines: smallest and largest value of each."""
    said = []
    for key in panels:
        unit, parts = PANELS[key].unit, []
        for trace in (trace for trace in lines if trace.key == key):
            for label, y in trace.columns.items():
                low, high = float(np.nanmin(y)), float(np.nanmax(y))
                parts.append(f"{label} {quantity(low, unit, False)} to {quantity(high, unit, False)}")
        said.append(f"{AXES[key].title}: {', '.join(parts)}")
    return "; ".join(said)
