"""Which figures a result can fill, section by section.

A figure exists only where there is something to draw; the page then says in its
place what is missing.
"""

from __future__ import annotations

from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import PageFigure, Rows
from attlog.report.figures.drift import drift_figures
from attlog.report.figures.flight import flight_figures
from attlog.report.figures.rest import rest_figures
from attlog.report.figures.sensors import sensor_figures
from attlog.report.figures.steps import step_figures
from attlog.report.figures.style import RowStyle
from attlog.result import Result


def sections(result: Result, looks: dict[str, RowStyle], store: ArrayPacker) -> dict[str, list[PageFigure]]:
    """Figures by section of the page: flight, rest, step, drift, sensors."""
    names = Rows({key: look.name for key, look in looks.items()})
    traces = [t for t in result.traces if (not t.row or t.row in looks) and len(t.t)]
    by = {kind: [t for t in traces if t.figure == kind] for kind in {t.figure for t in traces}}
    found = {
        "flight": flight_figures(by, names, store, result),
        "rest": rest_figures(by, names, store),
        "step": step_figures(by, names, store, result),
        "drift": drift_figures(by, names, store, result),
        "sensors": sensor_figures(by, names, store, result),
    }
    for part in found.values():
        fill(part)
    return found


def fill(part: list[PageFigure]) -> None:
    """Make a half-width figure wide where no other stands beside it."""
    beside = 0
    for i, figure in enumerate(part):
        beside = 0 if figure.wide else beside + 1
        if beside % 2 == 1 and (i + 1 == len(part) or part[i + 1].wide):
            figure.wide = True
