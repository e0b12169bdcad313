"""What ``analyze`` prints of one log: sentences, what is wrong with the log, the table of filters.

A row per filter, as many columns as there is room for. Lines are laid out here, not by rich: a cell is never cut, no
line ends with blanks, and signs that the output cannot show are replaced before anything is aligned.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from attlog.cli.shared.printing import TextLine, wrapped
from attlog.present.problems import ProblemText, nothing_wrong, problems
from attlog.present.stand_ins import stand_in
from attlog.present.text import clean, typeset

if TYPE_CHECKING:
    from attlog.present.table.cells import TableCell
    from attlog.present.table.table import Heading
    from attlog.result import EstimatorRow, Result


def printed(result: Result, window: str, width: int, encoding: str, verbose: bool = False) -> Iterator[TextLine]:
    """The lines for one log, at most ``width`` columns wide where words can be broken.

    ``window``: where the table looks; ``encoding``: of the output, signs that it lacks get
    stand-ins; ``verbose`` shows notes among the problems too.
    """
    from attlog.present.alike import alike
    from attlog.present.gyro_bias import gyro_bias

    def shown(text: str) -> str:
        return stand_in(text, encoding)

    yield TextLine(shown(clean(stand_in(str(result.log.get("name") or "log"), "utf-8"))), "bold")
    if result.headline:
        yield from wrapped("  ", shown(clean(result.headline)), width)
    for verdict in result.verdicts:
        yield from wrapped(f"  {verdict.question:<10}", shown(typeset(verdict.sentence)), width)
    for sentence in gyro_bias(result):
        yield from wrapped(f"  {'gyro bias':<10}", shown(typeset(sentence)), width)
    yield TextLine("")
    yield from wrong(problems(result), shown, width, verbose)
    table = comparison(result, window, width, shown)
    if table:
        yield TextLine("")
        yield from table
    for sentence in alike(result) if table else []:
        yield from wrapped("", shown(typeset(sentence)), width)


def wrong(found: list[ProblemText], shown: Callable[[str], str], width: int, verbose: bool) -> Iterator[TextLine]:
    """What is wrong with the log, the worst first, each with cause, remedy and meaning; notes only if ``verbose``."""
    listed = [p for p in found if verbose or p.style != "note"]
    yield TextLine(shown("What is wrong with this log"), "bold")
    nothing = nothing_wrong(listed, len(found) - len(listed))
    if nothing:
        yield TextLine(f"  {nothing}")
    for problem in listed:
        where = f" ({problem.where})" if problem.where else ""
        times = f" ({problem.count} times)" if problem.count > 1 and f" {problem.count} " not in problem.text else ""
        yield from wrapped(f"  {problem.label.lower()}: ", shown(f"{typeset(problem.text)}{where}{times}"), width)
        for label, text in problem.more:
            yield from wrapped(f"      {label:<4} ", shown(typeset(text)), width)


GAP = "  "
LEGEND = "* best (several: no significant difference)   ~ not ranked"
HALF = "   ± half of the 95 % interval"
SHORTEST_NAME = 8

Shown = Callable[[str], str]
"""A text as the output can show it."""


@dataclass(frozen=True, slots=True)
class Room:
    """How much a table shows: ids beside names, half intervals, full words, columns up to which ``spare``."""

    ids: bool
    halves: bool
    words: bool
    spare: int


ROOMS = (
    *(Room(ids, True, True, spare) for ids, spare in ((True, 9), (False, 9), (False, 4), (False, 3))),
    *(Room(False, halves, False, spare) for halves, spare in ((True, 9), (True, 3), (True, 2))),
    *(Room(False, False, False, spare) for spare in (2, 1, 0)),
)
"""What is tried in turn until a table fits."""


def comparison(result: Result, window: str, width: int, shown: Shown = str) -> list[TextLine]:
    """The table in at most ``width`` columns, with its legend; empty where no question has a value.

    ``*`` marks what is best, ``~`` what may not be ranked, a word says why a value is
    missing. Where there is little room half intervals go, then whole columns; the
    last line says which.
    """
    from attlog.present.names import row_names
    from attlog.present.table.table import main_table

    table = main_table(result, window)
    if not table.columns:
        return []
    names = {key: shown(clean(name)) for key, name in row_names(result).items()}
    for room in ROOMS:
        lines = laid_out(table.columns, table.rows, names, room, shown)
        if max(map(len, lines)) <= width:
            break
    else:
        longest = max(map(len, names.values()))
        least = max(longest - (max(map(len, lines)) - width), SHORTEST_NAME)
        names = {key: name if len(name) <= least else name[: least - 2] + ".." for key, name in names.items()}
        lines = laid_out(table.columns, table.rows, names, room, shown)
    left_out = [c.title[0].lower() + c.title[1:] for c in table.columns if c.spare > room.spare]
    halves = room.halves and any(c.half for _, cells in table.rows for c in cells)
    said = [LEGEND + (HALF if halves and len(LEGEND + HALF) <= width else "")]
    said += textwrap.wrap(f"No room for: {', '.join(left_out)}.", width) if left_out else []
    return [TextLine(line) for line in lines] + [TextLine(shown(line), "dim") for line in said]


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
        titled(shown(heading.title), shown(heading.unit), [shown(text(cells[i], room)) for _, cells in rows])
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


def titled(title: str, unit: str, cells: list[str]) -> tuple[list[str], list[str]]:
    """A heading broken into lines no wider than its cells or its longest word, and the cells."""
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
