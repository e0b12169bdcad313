"""Huang's figures, redrawn from the first seed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.reproduce.huang import runs
from attlog.reproduce.huang.runs import DCM, EKF, HOVER, LEVEL_AT, LEVEL_EVERY_S, LEVELS, NEW_EKF, TRACKS
from attlog.reproduce.lines import Span, drawn, filters
from attlog.reproduce.paper import TRUTH, FigureLine, PaperFigure
from attlog.reproduce.samples import angles, samples
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly

Array = NDArray[np.float64]
OWN, WANTED, LINEAR = "Huang's filter", "set-point", "transfer function"
AXES = ("roll, deg", "pitch, deg", "heading, deg")
STAND = "on the stand"
SINCE: Span = (HOVER[0], np.inf)


def figures(
    spent: dict[str, list[float]], printed_mahony: Sequence[float], printed_ekf: Sequence[float], seed: int = 0
) -> tuple[PaperFigure, ...]:
    """Filter against truth, against the EKF, cost, back to level, hover, tracking."""
    flight = fly(runs.scenario(DCM), seed)
    return (
        _against_truth(flight),
        _against_ekf(flight),
        _cost(spent, printed_mahony, printed_ekf),
        _level(flight, seed),
        _hover(flight),
        _tracking(flight),
    )


def _against_truth(flight: Flight) -> PaperFigure:
    return PaperFigure(
        "truth",
        "fig. 3",
        "The filter in the loop against the truth",
        "Hover, then three returns to level and two sines. Where the filter leaves the truth the vehicle has been "
        "tilted and gathers speed.",
        "time, s",
        AXES,
        _both(flight, len(AXES), SINCE),
        height=480,
    )


def _against_ekf(flight: Flight) -> PaperFigure:
    rows = {DCM: OWN, EKF: "Fan's EKF", NEW_EKF: "mekf"}
    return PaperFigure(
        "ekf",
        "fig. 4",
        "The filter and EKFs over the same samples, errors",
        "Errors against the truth, because the angles themselves could hardly be distinguished.",
        "time, s",
        tuple(f"error of {name}" for name in AXES),
        tuple(filters(samples(flight), rows, errors=True, span=SINCE)),
        height=480,
    )


def _cost(spent: dict[str, list[float]], mahony: Sequence[float], ekf: Sequence[float]) -> PaperFigure:
    run_of = np.arange(1.0, len(mahony) + 1.0)
    lines = (
        FigureLine("the paper", run_of, np.array(ekf) / np.array(mahony)),
        FigureLine("here", run_of, np.array(spent[EKF]) / np.array(spent[DCM])),
    )
    return PaperFigure(
        "cost",
        "table 1",
        "Time of the EKF over time of Mahony's filter",
        "4,000 updates, nine runs.",
        "run",
        ("ratio",),
        lines,
        kind="points",
        height=260,
    )


def _level(flight: Flight, seed: int) -> PaperFigure:
    """The three returns below each other: true angle and the filter's, on the stand, and the linear loop."""
    lines: list[FigureLine] = []
    held = runs.stand(seed)
    shown = np.linspace(-runs.TILTED_S, runs.LEVEL_S, 701)
    for k, (angle, axis) in enumerate(LEVELS):
        column = ("roll", "pitch").index(axis)
        since = LEVEL_AT + k * LEVEL_EVERY_S + runs.TILTED_S
        beside = runs.STAND_AT + k * runs.STAND_EVERY_S + runs.TILTED_S
        step = runs.axis_of(column).step
        linear = angle * (step(shown + runs.TILTED_S) - step(shown))
        lines += [
            FigureLine(TRUTH, shown, np.interp(since + shown, flight.truth.t, angles(flight.truth.q)[:, column]), k),
            FigureLine(OWN, shown, np.interp(since + shown, flight.onboard.t, _known(flight)[:, column]), k),
            FigureLine(
                f"truth {STAND}", shown, np.interp(beside + shown, held.truth.t, angles(held.truth.q)[:, column]), k
            ),
            FigureLine(LINEAR, shown, linear, k),
        ]
    panels = tuple(f"{axis} from {angle:g} deg, deg" for angle, axis in LEVELS)
    return PaperFigure(
        "level",
        "fig. 6",
        "From an angle back to level",
        "At 0 s the set-point becomes level. In free flight the filter believes it is level while the vehicle is not.",
        "time, s",
        panels,
        tuple(lines),
        height=480,
    )


def _hover(flight: Flight) -> PaperFigure:
    return PaperFigure(
        "hover",
        "fig. 8",
        "Hover",
        "Roll and pitch with the position held; the paper's bound is +-5 deg.",
        "time, s",
        AXES[:2],
        _both(flight, 2, HOVER),
    )


def _tracking(flight: Flight) -> PaperFigure:
    lines = []
    for k, (_, _, axis) in enumerate(TRACKS):
        column = ("roll", "pitch").index(axis)
        begin = runs.TRACK_AT + k * runs.TRACK_EVERY_S
        for name, t, y in (
            (TRUTH, flight.truth.t, angles(flight.truth.q)),
            (OWN, flight.onboard.t, _known(flight)),
            (WANTED, flight.onboard.t, angles(flight.onboard.q_setpoint)),
        ):
            lines.append(drawn(name, t - begin, y[:, column], k, (0.0, runs.TRACK_S)))
    panels = tuple(f"{axis}, sine of {period:g} s, deg" for _, period, axis in TRACKS)
    return PaperFigure(
        "tracking",
        "fig. 9",
        "Angles that follow a set-point",
        "The angle comes a fifth of a second later.",
        "time since the begin, s",
        panels,
        tuple(lines),
    )


def _both(flight: Flight, axes: int, span: Span) -> tuple[FigureLine, ...]:
    """The truth and what the filter on board made of it, axis by axis."""
    both = ((TRUTH, flight.truth.t, angles(flight.truth.q)), (OWN, flight.onboard.t, _known(flight)))
    return tuple(drawn(name, t, y[:, axis], axis, span) for axis in range(axes) for name, t, y in both)


def _known(flight: Flight) -> Array:
    """The filter's angles (n, 3) at all times; NaN before it has any."""
    q = flight.onboard.q
    found = np.full((len(q), 3), np.nan)
    known = np.isfinite(q[:, 0])
    found[known] = angles(q[known])
    return found
