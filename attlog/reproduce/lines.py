"""Lines of figures that several papers draw: angles or errors of filters over one flight, means with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.reproduce.paper import TRUTH, FigureLine, PaperNumber
from attlog.reproduce.samples import AXES, FlightSamples, angles, run

Array = NDArray[np.float64]
Span = tuple[float, float]
ALWAYS: Span = (-np.inf, np.inf)


def drawn(name: str, t: Array, y: Array, panel: int = 0, span: Span = ALWAYS) -> FigureLine:
    """A line of ``y`` (n,) at ``t`` (n,) s from ``span[0]`` to before ``span[1]``, thinned for a page."""
    part = (t >= span[0]) & (t < span[1])
    return FigureLine(name, *thinned(t[part], y[part]), panel)


def truths(s: FlightSamples, span: Span = ALWAYS, axes: int = len(AXES)) -> list[FigureLine]:
    """The true roll, pitch, heading [deg] of a flight, a panel each."""
    y = angles(s.q)
    return [drawn(TRUTH, s.t, y[:, axis], axis, span) for axis in range(axes)]


def filters(s: FlightSamples, rows: Mapping[str, str], errors: bool = False, span: Span = ALWAYS) -> list[FigureLine]:
    """What filters make of the samples of a flight: angles, or their ``errors``, by axis [deg], a panel each.

    ``rows``: filter (``mahony@xu-0.6``) to the line's name.
    """
    lines = []
    for row, name in rows.items():
        found = run(row, s)
        y = found.errors if errors else found.angles
        lines += [drawn(name, found.t, y[:, axis], axis, span) for axis in range(len(AXES))]
    return lines


def points(name: str, x: Sequence[float], numbers: Sequence[PaperNumber], panel: int = 0) -> FigureLine:
    """Numbers at ``x`` with the ends of their intervals; one without an interval is its own."""
    y = np.array([np.nan if n.value is None else n.value for n in numbers])
    ends = np.array([n.ci95 or (v, v) for n, v in zip(numbers, y, strict=True)])
    return FigureLine(name, x, y, panel, ends[:, 0], ends[:, 1])


def thinned(t: Array, y: Array, most: int = 8000) -> tuple[Array, Array]:
    """Every k-th point of a line ``y`` (n,) at ``t`` (n,), so that a page stays small."""
    every = -(-len(t) // most)
    return t[::every], y[::every]
