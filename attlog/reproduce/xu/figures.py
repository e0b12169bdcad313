"""Xu's figures, redrawn from the first seed, and what the gain does over all flights."""

from __future__ import annotations

import math
from collections.abc import Sequence

from attlog.present.numbers import quantity
from attlog.reproduce.judge import typical
from attlog.reproduce.lines import filters, points, truths
from attlog.reproduce.paper import PaperFigure, PaperTable
from attlog.reproduce.samples import AXES
from attlog.reproduce.xu.logs import LogOscillation
from attlog.reproduce.xu.runs import ADAPTIVE, FIXED, SWEPT, XuSeed, air, flown, gain

CALLED = {row: f"kp {kp:g}" for kp, row in FIXED.items()} | {ADAPTIVE: "adaptive (our law)"}


def figures(seeds: Sequence[XuSeed], logs: Sequence[LogOscillation], seed: int = 0) -> tuple[PaperFigure, ...]:
    """The mission, its errors, oscillation and error against the gain."""
    s = flown(seed)
    return (
        PaperFigure(
            "mission",
            "fig. 1 to 3",
            "A waypoint mission",
            "The first seed, between take-off and landing.",
            "time, s",
            tuple(f"{a}, deg" for a in AXES),
            (*truths(s, air()), *filters(s, CALLED, span=air())),
            height=480,
        ),
        PaperFigure(
            "errors",
            "fig. 1 to 3",
            "How far off",
            "The same mission: what was found minus the truth.",
            "time, s",
            tuple(f"{a} error, deg" for a in AXES),
            tuple(filters(s, CALLED, errors=True, span=air())),
            height=480,
        ),
        _by_gain("oscillation", "fig. 1 to 3", "How much it oscillates, by gain", seeds, logs),
        _errors_by_gain(seeds, logs),
    )


def _by_gain(id: str, where: str, title: str, seeds: Sequence[XuSeed], logs: Sequence[LogOscillation]) -> PaperFigure:
    lines = [
        points("simulated missions", SWEPT, [typical([s.rms[gain(kp)][axis] for s in seeds]) for kp in SWEPT], axis)
        for axis in range(3)
    ]
    if logs:
        lines += [
            points("logs", SWEPT, [typical([log.rms[gain(kp)][axis] for log in logs]) for kp in SWEPT], axis)
            for axis in range(3)
        ]
    return PaperFigure(
        id,
        where,
        title,
        "Geometric means over flights with their intervals, 0.2 to 5 Hz: of the error in simulation, on logs of what "
        "the filter pushes in beyond the gyro alone.",
        "kp, 1/s",
        tuple(f"{a}, deg" for a in AXES),
        tuple(lines),
        "points",
        height=480,
        x_log=True,
    )


def _errors_by_gain(seeds: Sequence[XuSeed], logs: Sequence[LogOscillation]) -> PaperFigure:
    lines = [
        points("simulated missions", SWEPT, [typical([s.tilt[gain(kp)] for s in seeds]) for kp in SWEPT], 0),
        points("simulated missions", SWEPT, [typical([s.heading[gain(kp)] for s in seeds]) for kp in SWEPT], 1),
    ]
    told = [log for log in logs if all(math.isfinite(v) for kp in SWEPT for v in log.errors.get(gain(kp), (math.nan,)))]
    if told:
        lines += [
            points("logs", SWEPT, [typical([log.errors[gain(kp)][k] for log in told]) for kp in SWEPT], k)
            for k in (0, 1)
        ]
    return PaperFigure(
        "best",
        "section 4",
        "How far off, by gain",
        "Geometric means of RMS errors over flights with their intervals; logs against their reference.",
        "kp, 1/s",
        ("tilt, deg", "heading, deg"),
        tuple(lines),
        "points",
        height=400,
        x_log=True,
    )


def table(seeds: Sequence[XuSeed], logs: Sequence[LogOscillation]) -> PaperTable:
    """Oscillation and errors of the paper's gains and of the adaptive one."""
    rows = []
    for row, name in CALLED.items():
        sets = [("missions", [s.rms[row] for s in seeds], [(s.tilt[row], s.heading[row]) for s in seeds])]
        if logs:
            sets.append(
                ("logs", [log.rms[row] for log in logs], [log.errors[row] for log in logs if row in log.errors])
            )
        for called, rms, errors in sets:
            cells = [typical([r[axis] for r in rms]) for axis in range(3)]
            cells += [typical([e[k] for e in errors]) for k in (0, 1)]
            rows.append((f"{name}, {called}", *(quantity(n.value, "deg") for n in cells)))
    head = ("gain", *(f"{a}, 0.2 to 5 Hz" for a in AXES), "error of tilt", "error of heading")
    return PaperTable("Oscillation and error", head, tuple(rows), "Geometric means over flights of RMS values.")
