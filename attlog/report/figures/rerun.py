"""Figure of a re-run onboard filter beside the states logged in flight."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from attlog.report.figures.figure import FigureSource, PageFigure, View, axis_key, panel_domain, range_words
from attlog.result import Trace
from attlog.words.flight import rerun_sentences
from attlog.words.numbers import unit_sign

# Colour, line width and name of the flown filter and of the re-run.
LOGGED, RERUN = ("edge", 2.6, "logged"), ("ac", 1.3, "run again")
# Views by name: key of the traces, unit, panels as column and title.
TILT_AND_HEADING = (("tilt", "tilt"), ("heading", "heading"))
GYRO_AXES = (("x", "x"), ("y", "y"), ("z", "z"))
TESTS = tuple((aid, aid) for aid in ("compass", "velocity", "position", "height", "airspeed"))
COMPASS = tuple((f"mag_{axis}", axis) for axis in "xyz")
ANGLES = (("heading", "heading"), ("sideslip", "sideslip"), ("declination", "declination"))
VELOCITY = (("velocity_n", "north"), ("velocity_e", "east"), ("velocity_d", "down"), ("airspeed", "airspeed"))
POSITION = (*(("position_n", "north"), ("position_e", "east")), *(("gnss_height", "GNSS"), ("baro_height", "baro")))
VIEWS = (
    ("Attitude, run again minus flown", "difference", "deg", TILT_AND_HEADING),
    ("Test ratios", "ratio", "1", TESTS),
    ("Gyro bias", "bias", "deg/s", GYRO_AXES),
    ("Sigmas", "sigma", "deg", TILT_AND_HEADING),
    ("Innovations: compass", "innovation", "uT", COMPASS),
    ("Innovations: heading", "innovation", "deg", ANGLES),
    ("Innovations: velocity", "innovation", "m/s", VELOCITY),
    ("Innovations: position", "innovation", "m", POSITION),
)
# Share of values outside the figure at each end, because innovations jump at a reset.
FAR_SHARE = 0.002


def rerun(source: FigureSource) -> PageFigure | None:
    """Draw attitude difference, test ratios, gyro bias, sigmas and innovations as views."""
    found = source.traces("rerun")
    first = next((t.row for t in found if t.row != "onboard"), None)
    if first is None:
        return None
    own = [t for t in found if t.row in (first, "onboard")]
    views, names = [], []
    for name, key, unit, columns in VIEWS:
        traces = [t for t in own if t.key == key]
        panels = [
            (column, title) for column, title in columns if any(column in t.columns for t in traces if t.row == first)
        ]
        if panels:
            view = source.view(name)
            _stack(view, traces, panels, unit, key == "ratio")
            views.append(view.as_data())
            names.append(name)
    caption = (
        f"{' '.join(rerun_sentences(source.result))} Blue: run again on the logged sensors; grey: logged in flight. "
    )
    caption += "Test ratio: innovation as a share of the gate, above 1 rejected."
    data = {"views": views, "timed": True, "phases": "named", "labels": "head"}
    data |= {"table": ["time_s", "quantity", "value", "unit"]}
    words = range_words([t for t in own if t.key == "difference"], source)
    return PageFigure("rerun", "plot", "What the filter did, run again", caption, 470, data, words=words, views=names)


def _stack(view: View, traces: Iterable[Trace], panels: Sequence[tuple[str, str]], unit: str, gate: bool) -> None:
    """Draw one panel per column, with the logged line below the re-run."""
    ordered = sorted(traces, key=lambda t: t.row != "onboard")
    for i, (column, title) in enumerate(panels):
        for trace in ordered:
            if column in trace.columns:
                colour, width, name = LOGGED if trace.row == "onboard" else RERUN
                meta = {"time": True, "quantity": f"{title}, {name}", "group": name, "digits": 3}
                meta |= {"free": True} if trace.key == "innovation" and trace.row == "onboard" else {}
                view.line(
                    name, colour, trace.t, trace.columns[column], unit=unit, width=width, yaxis=axis_key(i), meta=meta
                )
        if gate:
            ends = [float(min(t.t[0] for t in ordered)), float(max(t.t[-1] for t in ordered))]
            meta = {"time": True, "silent": True, "keyless": True}
            view.line("gate", "bad", ends, [1.0, 1.0], dash="dash", yaxis=axis_key(i), meta=meta)
        fit = {"floor": 0.0, "pad": 0.1, "least": 1.1, "most": 3.0} if gate else {"share": FAR_SHARE}
        sign = unit_sign(unit)
        domain = panel_domain(i, len(panels))
        view.axis(axis_key(i), f"{title}, {sign}" if sign else title, domain=domain, nticks=5, fit=fit)
    view.axis("x", "time, s", anchor=axis_key(len(panels) - 1))
