"""The table of filters on a terminal: a row per filter, as many columns as there is room for; a cell is never cut."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from attlog.cli.shared.printing import TextLine
from attlog.present.text import clean, typeset

if TYPE_CHECKING:
    from attlog.present.table.cells import TableCell
    from attlog.present.table.table import FilterTable, Heading
    from attlog.result import EstimatorRow, Result

GAP = "  "
MARKS = {"*": "* none significantly better", "~": "~ not ranked", "±": "± 95 %"}
AGAINST = {
    "truth": "Against {truth}",
    "smoother": "Against the smoother",
    "onboard": "Agreement with onboard, not truth",
}
SHORTEST_NAME = 8

Shown = Callable[[str], str]
"""A text as the output can show it."""


@dataclass(frozen=True, slots=True)
class Room:
    """How much a table shows: ids beside names, half intervals, full words, columns up to which ``spare``.

    ``short``: titles are short and stand on one line.
    """

    ids: bool
    halves: bool
    words: bool
    spare: int
    short: bool = False


ROOMS = (
    *(Room(ids, True, True, spare) for ids, spare in ((True, 9), (False, 9), (False, 4), (False, 3))),
    *(Room(False, halves, False, spare) for halves, spare in ((True, 9), (True, 3), (True, 2))),
    *(Room(False, False, False, spare) for spare in (2, 1, 0)),
)
"""What is tried in turn until a table fits."""
SHORT_ROOMS = (Room(False, True, False, 9, True), Room(False, False, False, 9, True))
"""The same of the short table."""


def comparison(result: Result, window: str, width: int, shown: Shown = str, verbose: bool = False) -> list[TextLine]:
    """The table in at most ``width`` columns, with its legend; empty where no question has a value.

    ``*`` marks rows that none is significantly better than, ``~`` what may not be ranked, a word says why a value is
    missing. Where there is little room half intervals go, then whole columns; the last line says which. Without
    ``verbose`` there is one column for each question, and no onboard source but what flew and the reference.
    """
    from attlog.present.names import row_names
    from attlog.present.table.table import main_table

    table = main_table(result, window) if verbose else shortened(main_table(result, window))
    if not table.columns:
        return []
    names = {key: shown(clean(name)) for key, name in row_names(result).items()}
    names |= {} if verbose else {"onboard": "Onboard"}
    for room in ROOMS if verbose else SHORT_ROOMS:
        lines = laid_out(table.columns, table.rows, names, room, shown)
        if max(map(len, lines)) <= width:
            break
    else:
        longest = max(len(names[row.name]) for row, _ in table.rows)
        least = max(longest - (max(map(len, lines)) - width), SHORTEST_NAME)
        names = {key: name if len(name) <= least else name[: least - 2] + ".." for key, name in names.items()}
        lines = laid_out(table.columns, table.rows, names, room, shown)
    left_out = [c.title[0].lower() + c.title[1:] for c in table.columns if c.spare > room.spare]
    said = legend(result, table, room, width, caveat=not verbose)
    ahead = [names[row.name] for row, _ in table.rows if not row.causal and not row.is_reference]
    said += textwrap.wrap(f"Looks ahead in time: {'; '.join(ahead)}.", width) if ahead else []
    for row in unfit(result):
        said += textwrap.wrap(f"{names[row.name]} failed: {row.reason.removeprefix(f'{row.name}: ')}.", width)
    said += textwrap.wrap(f"No room for: {', '.join(left_out)}.", width) if left_out else []
    return [TextLine(line) for line in lines] + [TextLine(shown(line), "dim") for line in said]


def unfit(result: Result) -> list[EstimatorRow]:
    """Filters that this log does not hold enough for: no trouble, so that nothing above the table tells why."""
    told = {f.text for f in result.findings if f.kind == "estimator_failed" and not f.is_trouble}
    return [row for row in result.estimators if f"{row.name}: {row.reason}" in told]


def shortened(table: FilterTable) -> FilterTable:
    """The first column of each question that has a short title, for filters, what flew and the reference.

    The gyro alone wins nothing and stands there only without other filters.
    """
    from attlog.present.table.rows import is_baseline
    from attlog.present.table.table import FilterTable

    first: dict[str, int] = {}
    for i, heading in enumerate(table.columns):
        if heading.short:
            first.setdefault(heading.short, i)
    filters = [r.name for r, _ in table.rows if r.kind == "replay"]
    filters = [r.name for r, _ in table.rows if r.name in filters and not is_baseline(r)] or filters
    rows = [(r, cells) for r, cells in table.rows if r.name in [*filters, "onboard"] or r.is_reference]
    return FilterTable(
        [table.columns[i] for i in first.values()], [(r, [c[i] for i in first.values()]) for r, c in rows]
    )


def against(result: Result, caveat: bool) -> str:
    """What errors are against, as a sentence, with a ``caveat`` where sentences with it do not stand above."""
    reference = result.reference
    if reference is None or reference.choice not in AGAINST:
        return ""
    from attlog.present.names import against_heading, truth_name

    borrowed = reference.heading_by == "onboard"
    parts = [
        AGAINST[reference.choice].format(truth=truth_name(result)),
        f"headings against {against_heading(result, 'onboard')}" if borrowed else "",
    ]
    parts.append(typeset(reference.caveat) if caveat else "")
    return "; ".join(part for part in parts if part) + "."


def legend(result: Result, table: FilterTable, room: Room, width: int, *, caveat: bool) -> list[str]:
    """What errors are against and what the marks mean, those that stand in the table."""
    cells = [cell for _, row in table.rows for cell in row]
    marks = {"*": any(c.best for c in cells), "~": any(c.unranked for c in cells)}
    marks["±"] = room.halves and any(c.half for c in cells)
    lines = textwrap.wrap(against(result, caveat), width)
    for part in (text for mark, text in MARKS.items() if marks[mark]):
        if lines and len(lines[-1]) + len(GAP) + len(part) <= width:
            lines[-1] += GAP + part
        else:
            lines.append(part)
    return lines


def laid_out(
    headings: list[Heading],
    rows: list[tuple[EstimatorRow, list[TableCell]]],
    names: dict[str, str],
    room: Room,
    shown: Shown,
) -> list[str]:
    """The lines of a table with this much room: headings of several lines, then a line per row."""
    left = [(["filter"], [names[r.name] + (" (reference)" if r.is_reference and room.words else "") for r, _ in rows])]
    if room.ids:
        left.append((["id"], [shown(clean(r.name)) for r, _ in rows]))
    right = [
        titled(heading, [shown(text(cells[i], room)) for _, cells in rows], room.short, shown)
        for i, heading in enumerate(headings)
        if heading.spare <= room.spare
    ]
    height = max(len(title) for title, _ in left + right)
    columns = [[""] * (height - len(title)) + title + cells for title, cells in left + right]
    padded = [
        [c.ljust(width) if i < len(left) else c.rjust(width) for c in column]
        for i, column in enumerate(columns)
        for width in (max(map(len, column)),)
    ]
    return [GAP.join(line).rstrip() for line in zip(*padded, strict=True)]


def titled(heading: Heading, cells: list[str], short: bool, shown: Shown) -> tuple[list[str], list[str]]:
    """A heading broken into lines no wider than its cells or its longest word, or a short one; and the cells."""
    unit = shown(heading.unit)
    if short:
        return [f"{shown(heading.short)} {unit} ".rstrip() + " "], cells
    title = shown(heading.title)
    width = max(map(len, [*cells, *title.split()]))
    lines = textwrap.wrap(title, width)
    if unit and len(lines[-1]) + 1 + len(unit) <= width:
        return [*lines[:-1], f"{lines[-1]} {unit}"], cells
    return lines + ([unit] if unit else []), cells


def text(cell: TableCell, room: Room) -> str:
    """What a cell says: its value and mark, or a word."""
    if cell.missing:
        return (cell.text if room.words else cell.brief) + " "
    half = f" {cell.half}" if room.halves and cell.half else ""
    return cell.text + half + ("*" if cell.best else "~" if cell.unranked else " ")
