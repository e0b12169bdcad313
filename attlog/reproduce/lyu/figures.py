"""Lyu's figures, redrawn from the first seed."""

from __future__ import annotations

import numpy as np

from attlog.reproduce.lyu import flight as lyu_flight
from attlog.reproduce.lyu import runs
from attlog.reproduce.lyu.runs import READINGS, fixed, stopped, variable
from attlog.reproduce.paper import TRUTH, FigureLine, PaperFigure
from attlog.reproduce.samples import angles, run

NAMES = {
    kind(reading): f"{name}, ki per {reading}"
    for reading in READINGS
    for kind, name in ((fixed, "fixed"), (variable, "variable"), (stopped, "input stopped"))
}
DRAWN = [row for row in runs.ROWS if row not in (stopped("second"), stopped("sample"))]


def figures(seed: int = 0) -> tuple[PaperFigure, ...]:
    """At rest, lifted and dropped, from a wrong start, in flight."""
    return _at_rest(seed), _dropped(seed), _wrong_start(seed), _flown(seed)


def _at_rest(seed: int) -> PaperFigure:
    s = runs.at_rest(seed)
    lines = [FigureLine(TRUTH, s.t[[0, -1]], angles(s.q)[[0, -1], axis], axis) for axis in (0, 1)]
    for row in DRAWN:
        found = run(row, s)
        lines += [FigureLine(NAMES[row], found.t, found.angles[:, axis], axis) for axis in (0, 1)]
    return PaperFigure(
        "rest",
        "fig. 4",
        "At rest on a tilted table",
        "Lines of the variable integral lie exactly on those of the fixed one. How far they are from the truth is the "
        "gyro's bias over kp and the accelerometer's own.",
        "time, s",
        ("roll, deg", "pitch, deg"),
        tuple(lines),
    )


def _dropped(seed: int) -> PaperFigure:
    s = runs.drop(seed, 60.0, 500.0)
    shown = (s.t > runs.STILL_S - 1.0) & (s.t < runs.DROP_AT + 15.0)
    lines = [FigureLine(TRUTH, s.t[shown], angles(s.q)[shown, 0], 0)]
    for row in DRAWN:
        found = run(row, s)
        part = (found.t >= s.t[shown][0]) & (found.t <= s.t[shown][-1])
        lines += [
            FigureLine(NAMES[row], found.t[part], found.angles[part, 0], 0),
            FigureLine(NAMES[row], found.t[part], found.errors[part, 0], 1),
        ]
    return PaperFigure(
        "drop",
        "fig. 5",
        "Lifted to 60 deg and dropped",
        "The gyro sees the whole movement; the blow disturbs.",
        "time, s",
        ("roll, deg", "error of roll, deg"),
        tuple(lines),
    )


def _wrong_start(seed: int) -> PaperFigure:
    s = runs.at_rest(seed)
    shown = 25.0
    lines = [FigureLine(TRUTH, [0.0, shown], [0.0, 0.0])]
    for row in runs.ROWS:
        found = runs.wrong_start(row, s, 60.0)
        part = found.t <= shown
        lines.append(FigureLine(NAMES[row], found.t[part], np.asarray(found.errors[part, 0]), 0))
    return PaperFigure(
        "start",
        "fig. 5",
        "An error of 60 deg",
        "The board rests, the filter starts 60 deg off in roll: nowhere else do the filters differ so much.",
        "time, s",
        ("error of roll, deg",),
        tuple(lines),
        height=300,
    )


def _flown(seed: int) -> PaperFigure:
    lines: list[FigureLine] = []
    for row in (fixed("second"), variable("second")):
        flight = lyu_flight.flight(row, seed)
        on, truth = flight.onboard, flight.truth
        shown = on.t >= lyu_flight.TRACK_S - 4.0
        t, found = on.t[shown], angles(on.q)[shown, 0]
        true = np.interp(t, truth.t, angles(truth.q)[:, 0])
        if not lines:
            lines += [FigureLine(TRUTH, t, true), FigureLine("set-point", t, angles(on.q_setpoint)[shown, 0])]
        lines += [FigureLine(NAMES[row], t, found), FigureLine(NAMES[row], t, found - true, 1)]
    return PaperFigure(
        "flight",
        "fig. 3",
        "In flight, roll on a sine",
        "Each filter flies its own flight; the truth is that of the first.",
        "time, s",
        ("roll, deg", "error of roll, deg"),
        tuple(lines),
    )
