"""Catalogue of figures: by section for the page, by name for plotly.

A figure is one builder, listed in SECTIONS. A builder returns None where there is nothing to draw.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from attlog.core.errors import UsageError
from attlog.report.figures import drift, flight, flight_data, rerun, rest, sensors, steps, vibration
from attlog.report.figures.figure import FigureSource, PageFigure
from attlog.result import Result

Builder = Callable[[FigureSource], PageFigure | None]
# Figures by section of the page, in its order.
SECTIONS: dict[str, tuple[Builder, ...]] = {
    "flight": (flight.strip, flight.attitude, flight_data.onboard_attitude, flight.difference, flight.track),
    "rest": (rest.close_up, rest.spread, rest.allan),
    "step": (steps.one_step, steps.all_steps, drift.lag, steps.setpoint),
    "drift": (drift.drift, drift.drifts),
    "rerun": (rerun.rerun,),
    "data": flight_data.BUILDERS,
    "sensors": (
        sensors.compass,
        sensors.field,
        sensors.interference,
        vibration.vibration,
        vibration.spectrum,
        sensors.gravity,
        sensors.ratios,
        sensors.bias,
    ),
}
# Name of the strip, which has no title on the page.
UNTITLED = "Flight modes, armed and airborne time, messages"


def sections(source: FigureSource) -> dict[str, list[PageFigure]]:
    """Build the figures of each section of the page."""
    found = {}
    for name, builders in SECTIONS.items():
        found[name] = [figure for build in builders if (figure := build(source)) is not None]
        widen_last(found[name])
    return found


def widen_last(part: list[PageFigure]) -> None:
    """Make the last half-width figure of a section wide if it has no partner."""
    beside = 0
    for i, figure in enumerate(part):
        beside = 0 if figure.wide else beside + 1
        if beside % 2 == 1 and (i + 1 == len(part) or part[i + 1].wide):
            figure.wide = True


class Album(NamedTuple):
    """Figures of a result by name, in the order of the page."""

    source: FigureSource
    found: dict[str, PageFigure]

    @classmethod
    def of(cls, result: Result) -> Album:
        """Build all figures; the comparison of the first screen comes first."""
        from attlog.report.figures.comparison import comparison

        source = FigureSource.of(result)
        first = comparison(source)
        parts = [[first] if first else [], *sections(source).values()]
        return cls(source, {figure.id: figure for part in parts for figure in part})

    @property
    def titles(self) -> dict[str, str]:
        """Titles by name."""
        return {name: figure.title or UNTITLED for name, figure in self.found.items()}

    def drawn(
        self,
        name: str,
        *,
        view: str | int = 0,
        rows: Sequence[str] | None = None,
        span: tuple[float, float] | None = None,
    ) -> dict[str, Any]:
        """Return ``data`` and ``layout`` of a figure for print; see :meth:`Result.figure`."""
        from attlog.report.figures.paper import PrintedFigure

        if name not in self.found:
            raise UsageError(_missing(self.source.result, name, self.found))
        start, end = span or self.source.marks["first"]
        if not start < end:
            raise UsageError(f"span: from {start:g} s to {end:g} s is no stretch of time")
        figure = self.found[name]
        chosen = _view(figure, view)
        shown = set(chosen["focus"]) if rows is None and "focus" in chosen else _shown(self.source, rows)
        ends = float(start), float(end)
        return PrintedFigure(figure, chosen, self.source.rows, shown, self.source.marks, ends).finished()


def _missing(result: Result, name: str, found: dict[str, PageFigure]) -> str:
    words = f"no figure {name!r}; this result has {', '.join(found)}"
    if result.traces:
        return words
    return f"{words}. It holds no lines, as none does that is read from JSON; attlog.analyze(log) gives one with them"


def _shown(source: FigureSource, rows: Sequence[str] | None) -> set[int]:
    """Return the positions of the rows to draw.

    ``rows``: ids or names; without them the rows that the page shows at first.
    """
    if rows is None:
        return {i for i, style in enumerate(source.rows) if style.shown}
    asked = [rows] if isinstance(rows, str) else list(rows)
    known = {style.name: i for i, style in enumerate(source.rows)}
    known |= {name: i for i, name in enumerate(source.styles)}
    if wrong := [name for name in asked if name not in known]:
        raise UsageError(f"rows: no row {wrong[0]!r}; this result has {', '.join(source.styles)}")
    return {known[name] for name in asked}


def _view(figure: PageFigure, view: str | int) -> dict[str, Any]:
    """Return a view of a figure by its number or name."""
    views = figure.data["views"]
    if isinstance(view, int) and -len(views) <= view < len(views):
        return dict(views[view])
    for i, name in enumerate(figure.views):
        if isinstance(view, str) and name.startswith(view):
            return dict(views[i])
    raise UsageError(f"{figure.id}: no view {view!r}; use {', '.join(map(repr, figure.views)) or 0}")
