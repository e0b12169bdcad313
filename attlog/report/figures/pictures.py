"""Which figures a result can fill, and each of them as a plotly figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from attlog.core.errors import UsageError
from attlog.report.figures import comparison, drift, flight, rest, sensors, steps, vibration
from attlog.report.figures.canvas import Canvas, PageFigure, PlainArrays, row_lines
from attlog.report.figures.catalogue import sections
from attlog.report.figures.panels import time_marks
from attlog.report.figures.style import RowStyle, row_styles
from attlog.result import Result

if TYPE_CHECKING:
    import plotly.graph_objects
__all__ = ["figure", "figures"]


DRAWERS: dict[str, Callable[[Canvas, dict[str, Any]], None]] = {
    "comparison": comparison.draw_comparison,
    "strip": flight.draw_strip,
    "attitude": flight.draw_attitude,
    "difference": flight.draw_difference,
    "rest": rest.draw_rest,
    "spread": rest.draw_spread,
    "allan": rest.draw_allan,
    "step": steps.draw_step,
    "steps": steps.draw_steps,
    "lag": drift.draw_lag,
    "setpoint": steps.draw_setpoint,
    "drift": drift.draw_drift,
    "drifts": drift.draw_drifts,
    "bias": sensors.draw_bias,
    "size": sensors.draw_size,
    "vibration": sensors.draw_vibration,
    "ratios": sensors.draw_ratios,
    "compass": sensors.draw_compass,
    "interference": sensors.draw_interference,
    "spectrum": vibration.draw_spectrum,
    "track": flight.draw_track,
}
"""The drawing function of each kind of figure; the page's scripts have the same kinds, but for the first screen."""

UNTITLED = "Flight modes, armed and airborne time, messages"
"""The strip has no title on the page: what stands on its axis tells."""


@dataclass(frozen=True, slots=True)
class Album:
    """The figures that a result can fill, by name in the order of the page, and what they share."""

    result: Result
    look: dict[str, RowStyle]
    found: dict[str, PageFigure]
    marks: dict[str, Any]

    @classmethod
    def of(cls, result: Result) -> Album:
        """Of a result, with arrays as they are."""
        look = row_styles(result)
        parts = [comparison.comparison_figure(result, look), *sections(result, look, PlainArrays()).values()]
        return cls(result, look, {f.id: f for part in parts for f in part}, time_marks(result))

    def drawn(
        self,
        name: str,
        *,
        view: str | int = 0,
        rows: Sequence[str] | None = None,
        span: tuple[float, float] | None = None,
    ) -> dict[str, Any]:
        """``data`` and ``layout`` of a figure; see :meth:`Result.figure`."""
        if name not in self.found:
            raise UsageError(_missing(self.result, name, self.found))
        start, end = span or self.marks["first"]
        if not start < end:
            raise UsageError(f"span: from {start:g} s to {end:g} s is no stretch of time")
        own = self.found[name]
        data = own.data | _view(own, view)
        shown = set(data["focus"]) if rows is None and "focus" in data else _shown(self.look, rows)
        canvas = Canvas(row_lines(self.look.values()), shown, self.marks, (float(start), float(end)))
        DRAWERS[own.kind](canvas, data)
        return canvas.finished()


def figures(result: Result) -> dict[str, str]:
    """Titles of the figures that the result can fill, by their names; see :meth:`Result.figures`."""
    return {name: f.title or UNTITLED for name, f in Album.of(result).found.items()}


def figure(result: Result, name: str, **options: Any) -> plotly.graph_objects.Figure:
    """One figure; see :meth:`Result.figure`."""
    import plotly.graph_objects as go

    return go.Figure(Album.of(result).drawn(name, **options))


def _missing(result: Result, name: str, found: dict[str, PageFigure]) -> str:
    """Why there is no such figure."""
    words = f"no figure {name!r}; this result has {', '.join(found)}"
    if result.traces:
        return words
    return f"{words}. It holds no lines, as none does that is read from JSON; attlog.analyze(log) gives one with them"


def _shown(look: dict[str, RowStyle], rows: Sequence[str] | None) -> set[int]:
    """Positions of the rows to draw: those asked for, by id or name, else those that the page shows at first."""
    if rows is None:
        return {i for i, own in enumerate(look.values()) if own.shown}
    asked = [rows] if isinstance(rows, str) else list(rows)
    known = {name: i for i, own in enumerate(look.values()) for name in (own.name,)}
    known |= {name: i for i, name in enumerate(look)}
    if wrong := [name for name in asked if name not in known]:
        raise UsageError(f"rows: no row {wrong[0]!r}; this result has {', '.join(look)}")
    return {known[name] for name in asked}


def _view(drawn: PageFigure, view: str | int) -> dict[str, Any]:
    """What can be chosen in a figure, by its place or its name on the page."""
    views = drawn.data.get("views") or [{}]
    if isinstance(view, int) and -len(views) <= view < len(views):
        return dict(views[view])
    for i, called in enumerate(drawn.views):
        if isinstance(view, str) and called.startswith(view):
            return dict(views[i])
    raise UsageError(f"{drawn.id}: no view {view!r}; use {', '.join(map(repr, drawn.views)) or 0}")


# The figures of the report as plotly figures in a journal's style: :func:`figures`, :func:`figure`.
