"""Fan's figures, redrawn from the first seed, and the spread of all seeds by axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from attlog.reproduce.fan.runs import EKF, FILTER, RAW, ROWS, FanSeed, at_rest, turned
from attlog.reproduce.judge import mean
from attlog.reproduce.paper import TRUTH, FigureLine, PaperFigure
from attlog.reproduce.samples import AXES, FlightSamples, angles, run

PANELS = tuple(f"{axis}, deg" for axis in AXES)


def figures(found: Sequence[FanSeed], called: Mapping[str, str], seed: int = 0) -> tuple[PaperFigure, ...]:
    """At rest, in rotation, its errors, and the spread at rest over all seeds."""
    still, moved = at_rest(seed), turned(seed)
    return (
        PaperFigure(
            "rest",
            "fig. 4",
            "At rest",
            "The first seed. Hide the raw angles to see the others.",
            "time, s",
            PANELS,
            (*_truth(still), *_lines(still, called, errors=False)),
            height=460,
        ),
        PaperFigure(
            "turned",
            "fig. 5",
            "By hand to 45 deg both ways about each axis",
            "The first seed.",
            "time, s",
            PANELS,
            (*_truth(moved), *_lines(moved, called, errors=False)),
            height=460,
        ),
        PaperFigure(
            "errors",
            "fig. 5",
            "How far off in rotation",
            "What was found minus the truth.",
            "time, s",
            tuple(f"{axis} error, deg" for axis in AXES),
            _lines(moved, called, errors=True),
            height=460,
        ),
        _spread(found, called),
    )


def _truth(s: FlightSamples) -> tuple[FigureLine, ...]:
    return tuple(FigureLine(TRUTH, s.t, angles(s.q)[:, axis], axis) for axis in range(3))


def _lines(s: FlightSamples, called: Mapping[str, str], errors: bool) -> tuple[FigureLine, ...]:
    lines = []
    for row in (RAW, FILTER, EKF):
        found = run(row, s)
        y = found.errors if errors else found.angles
        lines += [FigureLine(called[row], found.t, y[:, axis], axis) for axis in range(3)]
    return tuple(lines)


def _spread(found: Sequence[FanSeed], called: Mapping[str, str]) -> PaperFigure:
    lines = []
    for row in ROWS[1:]:
        numbers = [mean("", [s.spread[row][axis] for s in found], "deg") for axis in range(3)]
        y = np.array([np.nan if n.value is None else n.value for n in numbers])
        ends = np.array([n.ci95 or (v, v) for n, v in zip(numbers, y, strict=True)])
        lines.append(FigureLine(called[row], [0.0, 1.0, 2.0], y, 0, ends[:, 0], ends[:, 1]))
    return PaperFigure(
        "spread",
        "fig. 4",
        "Spread at rest by axis and by the Kalman filter's random walks",
        "Means over seeds with their intervals; raw angles (several times as much) are in the table.",
        "",
        ("standard deviation, deg",),
        tuple(lines),
        "points",
        AXES,
        300,
    )
