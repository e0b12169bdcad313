"""The comparison as rows and cells: what the page and the terminal lay out."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field

from attlog.present.numbers import unit_sign
from attlog.present.table.cells import TableCell, cell
from attlog.present.table.columns import AXIS_COLUMNS, ERRORS, NOISE, TableColumn, columns
from attlog.present.table.rows import has_value, ordered, window_of
from attlog.result import EstimatorRow, Result


@dataclass(frozen=True, slots=True)
class Heading:
    """One heading: title, unit, the metric and window it stands for, how soon it may be left out, a short title."""

    title: str
    unit: str
    metric: str
    window: str
    spare: int = 0
    short: str = ""


@dataclass(slots=True)
class FilterTable:
    """Headings, and (row, cells) for every row."""

    columns: list[Heading] = field(default_factory=list)
    rows: list[tuple[EstimatorRow, list[TableCell]]] = field(default_factory=list)

    @property
    def partial(self) -> bool:
        """Whether a cell says that only part of the time could be compared."""
        return any(small.startswith("of ") for _, cells in self.rows for c in cells for small in c.small)


def main_table(result: Result, window: str = "all") -> FilterTable:
    """The comparison of all rows: every column in which at least one row has a value.

    With ``window`` other than ``all`` every column is looked up there only.
    """
    chosen = columns(result)
    if window != "all":
        chosen = [dataclasses.replace(c, windows=(window,)) for c in chosen if c.metric != NOISE]
        chosen.insert(len(ERRORS), TableColumn("Noise", NOISE, (window,), short="Noise"))
    return filled(result, chosen)


def axis_table(result: Result) -> FilterTable:
    """Lag, gain and shape of the steps by axis."""
    return filled(result, AXIS_COLUMNS)


def window_tables(result: Result) -> dict[str, FilterTable]:
    """Every metric of every window: the expert's tables."""
    windows = dict.fromkeys(w for r in result.estimators for w in r.metrics)
    out = {}
    for window in windows:
        metrics = dict.fromkeys(m for r in result.estimators for m in r.metrics.get(window, {}))
        contests = [TableColumn(m, m, (window,), not m.startswith(("step_gain", "distortion"))) for m in metrics]
        table = filled(result, contests)
        if table.columns:
            out[window] = table
    return out


def filled(result: Result, wanted: Iterable[TableColumn]) -> FilterTable:
    """The columns in which at least one row has a value, for all rows, each in one window."""
    rows = ordered(result)
    table, chosen = FilterTable(), []
    for column in wanted:
        window = window_of(result, column.metric, column.windows)
        answers = (row.metrics.get(window, {}).get(column.metric) for row in rows)
        first = next((a for a in answers if a is not None and has_value(a)), None)
        if first is not None:
            table.columns.append(
                Heading(column.title, unit_sign(first.unit), column.metric, window, column.spare, column.short)
            )
            chosen.append((column, window))
    table.rows = [(row, [cell(result, row, column, window) for column, window in chosen]) for row in rows]
    return table
