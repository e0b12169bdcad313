"""Lyu's figures, redrawn from the first seed."""

from __future__ import annotations

import numpy as np

from attlog.reproduce.lines import drawn, truths
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
        lines += [drawn(NAMES[row], found.t, found.angles[:, axis], axis) for axis in (0, 1)]
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
    span = (runs.STILL_S - 1.0, runs.DROP_AT + 15.0)
    lines = truths(s, span, axes=1)
    for row in DRAWN:
        found = run(row, s)
        lines += [
            drawn(NAMES[row], found.t, found.angles[:, 0], 0, span),
            drawn(NAMES[row], found.t, found.errors[:, 0], 1, span),
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
        lines.append(drawn(NAMES[row], found.t, found.errors[:, 0], span=(0.0, shown)))
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
        late = on.t >= lyu_flight.TRACK_S - 4.0
        t, found = on.t[late], angles(on.q)[late, 0]
        true = np.interp(t, truth.t, angles(truth.q)[:, 0])
        if not lines:
            lines += [drawn(TRUTH, t, true), drawn("set-point", t, angles(on.q_setpoint)[late, 0])]
        lines += [drawn(NAMES[row], t, found), drawn(NAMES[row], t, found - true, 1)]
    return PaperFigure(
        "flight",
        "section 3.2",
        "In flight, roll on a sine",
        "Each filter flies its own flight; the truth is that of the first.",
        "time, s",
        ("roll, deg", "error of roll, deg"),
        tuple(lines),
    )
