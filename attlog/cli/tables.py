"""The assessments of sensors on a terminal: the table of ``attlog health``, and the line that ``analyze`` adds."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from attlog.cli.printing import SENTENCES, TextLine, wrapped
from attlog.words.findings import (
    ShownAssessment,
    ShownFinding,
    findings,
    no_problem_text,
    parameter_change,
    question_titles,
    reasons_unknown,
    repeat_advice_once,
    shown_assessments,
)
from attlog.words.numbers import listed
from attlog.words.text import clean, encodable, typeset

if TYPE_CHECKING:
    from attlog.result import Assessment, EstimatorRow, Result, Setting
    from attlog.words.table import ColumnHeading, FilterTable, TableCell


STYLES = {"fault": "red", "warning": "yellow"}
LABEL = 10
"""Columns of what a line is about, as of the findings and answers of ``analyze``."""
SENSOR_GAP = 2

ShownText = Callable[[str], str]
"""A text as the output can show it."""


def sensor_lines(health: Sequence[Assessment], shown: ShownText, width: int, verbose: bool) -> Iterator[TextLine]:
    """The table of what is off or may be set, faults first; what is ok and what cannot be told in a line each, with the
    number of sensors where there are several.

    ``verbose``: what is ok as rows, too, the evidence of each, and why the rest cannot be told.
    """
    every = shown_assessments(health)
    ok = [a for a in every if a.verdict == "ok" and not a.listed]
    silent = [a for a in every if a.verdict == "unknown" and not a.listed]
    listed = [a for a in every if a.listed]
    yield from _table(repeat_advice_once(listed + ok if verbose else listed), shown, width, verbose)
    if ok and not verbose:
        yield from wrapped("  ok: ", shown(question_titles(ok)), width)
    if silent and not verbose:
        yield from wrapped("  no answer: ", shown(f"{question_titles(silent)} (why: -v)"), width)
    for questions, why in reasons_unknown(silent) if verbose else ():
        yield from wrapped("  no answer: ", shown(questions), width)
        yield from _below([why], shown, width, 6, "dim")
    if not every:
        yield TextLine("  No question about a sensor can be answered from this log.")


def setting_lines(settings: Sequence[Setting]) -> Iterator[TextLine]:
    """What should be set, a line each: ``NAME old -> new``."""
    if settings:
        yield TextLine("set", "bold")
        yield from (TextLine(f"  {parameter_change(setting)}") for setting in settings)


def set_line(settings: Sequence[Setting], log: str, width: int) -> Iterator[TextLine]:
    """At most two lines of what should be set, and which command shows why; none where there is nothing."""
    from attlog.words.findings import parameter_changes

    width = min(width, SENTENCES)
    why = f"attlog health {log} shows why."
    for most in range(len(settings), 0, -1):
        lines = list(wrapped(f"{'set':<{LABEL}}", f"{parameter_changes(settings, most)}; {why}", width))
        if len(lines) <= 2 and all(len(line.text) <= width for line in lines):
            yield from lines
            return
    if settings:
        yield TextLine(f"{'set':<{LABEL}}{len(settings)} parameters; attlog health shows which and why.")


def _table(rows: Sequence[ShownAssessment], shown: ShownText, width: int, verbose: bool) -> Iterator[TextLine]:
    """A row for each: sensor, question, verdict, value; below it what was found and what to set or to do.

    Where long names leave no columns for the value it begins the lines below. ``verbose``: then what else is known.
    """
    if not rows:
        return
    head = ("sensor", "question", "verdict", "value")
    cells = [tuple(shown(text) for text in (a.sensor, a.question, a.verdict, a.value)) for a in rows]
    widths = [max(len(row[i]) for row in (head, *cells)) + SENSOR_GAP for i in range(len(head))]
    beside = len(head) if SENSOR_GAP + sum(widths) - SENSOR_GAP <= width else len(head) - 1
    laid = [(" " * SENSOR_GAP + "".join(map(str.ljust, row[:beside], widths))).rstrip() for row in (head, *cells)]
    yield TextLine(laid[0], "bold")
    for a, line, row in zip(rows, laid[1:], cells, strict=True):
        yield TextLine(line, STYLES.get(a.verdict, ""))
        yield from _below([*row[beside:], a.text, a.to_set], shown, width)
        yield from _below(a.why if verbose else (), shown, width, 6, "dim")


def _below(texts: Sequence[str], shown: ShownText, width: int, indent: int = 4, style: str = "") -> Iterator[TextLine]:
    """Texts below a row, each from a line of its own; what is empty is left out."""
    for text in filter(None, texts):
        yield from (TextLine(line.text, style) for line in wrapped(" " * indent, shown(text), width))


# The table of filters on a terminal: a row per filter, as many columns as there is room for; a cell is never cut.

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
    from attlog.words.names import row_names
    from attlog.words.table import main_table

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
    from attlog.words.ranking import is_baseline
    from attlog.words.table import FilterTable

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
    from attlog.words.names import against_heading, truth_name

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
    headings: list[ColumnHeading],
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


def titled(heading: ColumnHeading, cells: list[str], short: bool, shown: Shown) -> tuple[list[str], list[str]]:
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


# What ``analyze`` prints of one log: what happened, what is wrong with the log, four answers, the table of filters.
#
# Lines are laid out here, not by rich: no line ends with blanks, and signs that the output cannot show are replaced
# before anything is aligned.

ANSWER = 10
"""Columns of the name of a question."""
SHOWN = 5
"""So many findings stand above the answers; -v lists all."""


def printed(result: Result, window: str, width: int, encoding: str, verbose: bool = False) -> Iterator[TextLine]:
    """The lines for one log, at most ``width`` columns wide where words can be broken.

    Title, headline, findings, what to set, four answers, the table: 19 lines of 80 columns at most of a healthy log.
    ``window``: where the table looks; ``encoding``: of the output, signs that it lacks get stand-ins; ``verbose``:
    every finding and why, whole sentences instead of short answers, every column and row of the table, which else
    stands only where filters were compared.
    """
    from attlog.result import agreed_settings
    from attlog.words.names import duplicate_rows_text

    def shown(text: str) -> str:
        return encodable(text, encoding)

    yield from (TextLine(line.text, "bold") for line in wrapped("", shown(title(result)), width))
    if result.headline:
        yield from wrapped("  ", shown(clean(result.headline)), width)
    found = findings(result)
    if verbose or any(not finding.is_note for finding in found):
        yield from wrong(found, shown, width, verbose)
    name = clean(encodable(str(result.log.get("name") or "LOG"), "utf-8"))
    yield from (TextLine(shown(line.text)) for line in set_line(agreed_settings(result.health), name, width))
    for label, sentence in answers(result, min(width, SENTENCES) - ANSWER, verbose):
        yield from wrapped(f"{label:<{ANSWER}}", shown(sentence), width)
    compared = verbose or window != "all" or any(any(rows.values()) for rows in result.ranked.values())
    table = comparison(result, window, width, shown, verbose) if compared else []
    if table:
        yield TextLine("")
        yield from table
        for sentence in duplicate_rows_text(result, equations=verbose):
            yield from wrapped("", shown(typeset(sentence)), width)


def title(result: Result) -> str:
    """Which log it is: the file, what flew with which firmware, how long the log is."""
    from attlog.words.flight import firmware
    from attlog.words.numbers import duration

    log = result.log
    about = [str(log.get("vehicle") or ""), firmware(result).partition(" on ")[0]]
    about += ["simulated" if log.get("simulated") else "", duration(log.get("duration_s"))]
    name = clean(encodable(str(log.get("name") or "log"), "utf-8"))
    return f"{name}; {clean(', '.join(part for part in about if part))}"


def answers(result: Result, width: int, verbose: bool) -> Iterator[tuple[str, str]]:
    """Return the answers with their labels; ``verbose``: whole, with notes and what was subtracted from the gyro."""
    from attlog.words.answers import QUESTIONS, answer_lines
    from attlog.words.flight import gyro_bias_text

    if verbose:
        for verdict in result.verdicts:
            yield QUESTIONS.get(verdict.question, verdict.question), typeset(verdict.sentence)
            yield from (("", typeset(note)) for note in verdict.notes)
        yield from (("gyro bias", typeset(sentence)) for sentence in gyro_bias_text(result))
    elif result.verdicts:
        found = {QUESTIONS[q]: typeset(answer.within(width)) for q, answer in answer_lines(result).items()}
        yield from said_once(found)


def said_once(found: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Answers with their labels; a reason why several questions have none stands once, behind their names."""
    from attlog.words.answers import NO_ANSWER

    asked: dict[str, list[str]] = {}
    for label, sentence in found.items():
        if sentence.startswith(NO_ANSWER):
            asked.setdefault(sentence, []).append(label)
    shared = {sentence: labels for sentence, labels in asked.items() if len(labels) > 1}
    yield from ((label, sentence) for label, sentence in found.items() if sentence not in shared)
    for sentence, labels in shared.items():
        yield "no answer", f"{listed(labels)[:1].upper()}{listed(labels)[1:]}: {sentence.removeprefix(NO_ANSWER)}"


def wrong(found: list[ShownFinding], shown: Callable[[str], str], width: int, verbose: bool) -> Iterator[TextLine]:
    """What is wrong with the log and what to do, a line each, the worst first; ``verbose``: notes, and why."""
    every = [f for f in found if verbose or not f.is_note]
    nothing = no_problem_text(every, len(found) - len(every))
    if nothing:
        yield TextLine(f"  {nothing}")
    kept = every if verbose or len(every) <= SHOWN + 1 else every[:SHOWN]
    for finding in kept:
        style = {"bad": "red", "warn": "yellow"}.get(finding.style, "")
        begin = f"{finding.label.lower():<{ANSWER}}"
        yield from (TextLine(line.text, style) for line in wrapped(begin, shown(finding.line), width))
        for text in finding.why if verbose else ():
            yield from (TextLine(line.text, "dim") for line in wrapped(" " * (ANSWER + 2), shown(text), width))
    if len(kept) < len(every):
        yield TextLine(f"{'':<{ANSWER}}and {len(every) - len(kept)} more with -v")
