"""Fan's figures, redrawn from the first seed, and the spread of all seeds by axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from attlog.reproduce.fan.runs import EKF, FILTER, RAW, ROWS, FanSeed, at_rest, turned
from attlog.reproduce.judge import mean
from attlog.reproduce.lines import filters, points, truths
from attlog.reproduce.paper import PaperFigure
from attlog.reproduce.samples import AXES

PANELS = tuple(f"{axis}, deg" for axis in AXES)


def figures(found: Sequence[FanSeed], called: Mapping[str, str], seed: int = 0) -> tuple[PaperFigure, ...]:
    """At rest, in rotation, its errors, and the spread at rest over all seeds."""
    still, moved = at_rest(seed), turned(seed)
    rows = {row: called[row] for row in (RAW, FILTER, EKF)}
    return (
        PaperFigure(
            "rest",
            "fig. 4a, 5a",
            "At rest",
            "The first seed. Hide the raw angles to see the others.",
            "time, s",
            PANELS,
            (*truths(still), *filters(still, rows)),
            height=460,
        ),
        PaperFigure(
            "turned",
            "fig. 4b, 5b",
            "By hand to 45 deg both ways about each axis",
            "The first seed.",
            "time, s",
            PANELS,
            (*truths(moved), *filters(moved, rows)),
            height=460,
        ),
        PaperFigure(
            "errors",
            "fig. 5b",
            "How far off in rotation",
            "What was found minus the truth.",
            "time, s",
            tuple(f"{axis} error, deg" for axis in AXES),
            tuple(filters(moved, rows, errors=True)),
            height=460,
        ),
        _spread(found, called),
    )


def _spread(found: Sequence[FanSeed], called: Mapping[str, str]) -> PaperFigure:
    lines = []
    for row in ROWS[1:]:
        spreads = [mean("", [s.spread[row][axis] for s in found], "deg") for axis in range(len(AXES))]
        lines.append(points(called[row], range(len(AXES)), spreads))
    return PaperFigure(
        "spread",
        "fig. 5a",
        "Spread at rest by axis and by the Kalman filter's random walks",
        "Means over seeds with their intervals; raw angles (several times as much) are in the table.",
        "",
        ("standard deviation, deg",),
        tuple(lines),
        "points",
        AXES,
        300,
    )
