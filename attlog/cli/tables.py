"""One log on a terminal: what happened, findings, answers, the table of filters, the table of sensors."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from attlog.cli.printing import GAP, SENTENCE_COLUMNS, TextLine, table, wrapped
from attlog.words.findings import (
    ShownCheck,
    ShownFinding,
    findings,
    no_problem_text,
    parameter_change,
    question_titles,
    reasons_unknown,
    repeat_advice_once,
    shown_checks,
)
from attlog.words.numbers import listed
from attlog.words.text import clean, encodable, typeset

if TYPE_CHECKING:
    from attlog.result import Check, EstimatorRow, Result, Setting
    from attlog.words.table import FilterTable, TableCell, TableColumn

VERDICT_STYLES = {"fault": "red", "warning": "yellow"}
FINDING_STYLES = {"bad": "red", "warn": "yellow"}
LABEL_COLUMNS = 10  # of the name of a question
MAX_FINDINGS = 5  # above the answers without -v
MARKS = {"*": "* none significantly better", "~": "~ not ranked", "±": "± 95 %"}
AGAINST = {
    "truth": "Against {truth}",
    "smoother": "Against the smoother",
    "onboard": "Agreement with onboard, not truth",
}
ALL_COLUMNS = 9  # above every ``spare``


def result_lines(result: Result, window: str, width: int, verbose: bool = False) -> Iterator[TextLine]:
    """Lines of one log, at most ``width`` columns wide where words can be broken.

    Title, headline, findings, what to set, four answers, the table: 19 lines of 80 columns at most of a healthy log.
    The table shows ``window``, without ``verbose`` only where filters were compared. ``verbose``: every finding and
    why, whole sentences, every column and row.
    """
    from attlog.result import agreed_settings
    from attlog.words.flight import rerun_sentences
    from attlog.words.names import duplicate_rows_text

    yield from first_lines(result, width)
    found = findings(result)
    if verbose or any(not finding.is_note for finding in found):
        yield from finding_lines(found, width, verbose)
    name = clean(encodable(str(result.log.get("name") or "LOG"), "utf-8"))
    yield from set_line(agreed_settings(result.checks), name, width)
    for sentence in rerun_sentences(result):
        yield from wrapped(f"{'re-run':<{LABEL_COLUMNS}}", sentence, min(width, SENTENCE_COLUMNS))
    for label, sentence in answers(result, min(width, SENTENCE_COLUMNS) - LABEL_COLUMNS, verbose):
        yield from wrapped(f"{label:<{LABEL_COLUMNS}}", sentence, width)
    compared = verbose or window != "all" or any(any(rows.values()) for rows in result.ranked.values())
    shown = filter_table(result, window, width, verbose) if compared else []
    if shown:
        yield TextLine("")
        yield from shown
        for sentence in duplicate_rows_text(result, equations=verbose):
            yield from wrapped("", typeset(sentence), width)


def first_lines(result: Result, width: int) -> Iterator[TextLine]:
    """Title and headline, as far as they are known."""
    yield from wrapped("", title(result), width, "bold")
    if result.headline:
        yield from wrapped("  ", clean(result.headline), width)


def title(result: Result) -> str:
    """Name the log: the file, what flew with which firmware, how long the log is."""
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
    from attlog.words.names import is_against_onboard

    labels = QUESTIONS | ({"accuracy": "agreement"} if is_against_onboard(result) else {})
    if verbose:
        for verdict in result.verdicts:
            yield labels.get(verdict.question, verdict.question), typeset(verdict.sentence)
            yield from (("", typeset(note)) for note in verdict.notes)
        yield from (("gyro bias", typeset(sentence)) for sentence in gyro_bias_text(result))
    elif result.verdicts:
        found = {labels[q]: typeset(answer.within(width)) for q, answer in answer_lines(result).items()}
        yield from merge_missing(found)


def merge_missing(found: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Answers with their labels; a reason why several questions have none appears once, after their names."""
    from attlog.words.answers import NO_ANSWER

    asked: dict[str, list[str]] = {}
    for label, sentence in found.items():
        if sentence.startswith(NO_ANSWER):
            asked.setdefault(sentence, []).append(label)
    shared = {sentence: labels for sentence, labels in asked.items() if len(labels) > 1}
    yield from ((label, sentence) for label, sentence in found.items() if sentence not in shared)
    for sentence, labels in shared.items():
        yield "no answer", f"{listed(labels)[:1].upper()}{listed(labels)[1:]}: {sentence.removeprefix(NO_ANSWER)}"


def finding_lines(found: list[ShownFinding], width: int, verbose: bool) -> Iterator[TextLine]:
    """Yield findings with actions, a line each, worst first; ``verbose``: notes and reasons."""
    every = [f for f in found if verbose or not f.is_note]
    if nothing := no_problem_text(every, len(found) - len(every)):
        yield TextLine(f"  {nothing}")
    kept = every if verbose or len(every) <= MAX_FINDINGS + 1 else every[:MAX_FINDINGS]
    for finding in kept:
        style = FINDING_STYLES.get(finding.style, "")
        yield from wrapped(f"{finding.label.lower():<{LABEL_COLUMNS}}", finding.line, width, style)
        for text in finding.why if verbose else ():
            yield from wrapped(" " * (LABEL_COLUMNS + 2), text, width, "dim")
    if len(kept) < len(every):
        yield TextLine(f"{'':<{LABEL_COLUMNS}}and {len(every) - len(kept)} more with -v")


def filter_table(result: Result, window: str, width: int, verbose: bool = False) -> list[TextLine]:
    """Table of the filters in at most ``width`` columns, with its legend; empty if no question has a value.

    ``*`` marks rows that none is significantly better than, ``~`` rows that may not be ranked; a word says why a value
    is missing. A narrow table loses ids, then half intervals, then columns: with ``verbose`` they follow in further
    tables, else the last line names them. Without ``verbose`` it has a column for each question, and of the onboard
    sources only what flew and the reference.
    """
    from attlog.words.names import row_names
    from attlog.words.table import main_table

    found = main_table(result, window) if verbose else shortened(main_table(result, window))
    if not found.columns:
        return []
    names = {key: clean(name) for key, name in row_names(result).items()}
    names |= {} if verbose else {"onboard": "Onboard"}
    halves, spare, lines = True, ALL_COLUMNS, list[TextLine]()
    layouts = [(True, True, ALL_COLUMNS)] if verbose else []
    layouts += [(False, True, ALL_COLUMNS), *((False, False, most) for most in (ALL_COLUMNS, 3, 2, 1, 0))]
    for ids, halves, spare in layouts:
        lines = _filter_rows(found, names, ids, halves, spare, not verbose)
        if max(len(line.text) for line in lines) <= width:
            break
    legend = _legend(result, found, halves, width, caveat=not verbose)
    ahead = [names[row.name] for row, _ in found.rows if not row.causal and not row.is_reference]
    legend += [f"Looks ahead in time: {'; '.join(ahead)}."] if ahead else []
    legend += [f"{names[r.name]} failed: {r.reason.removeprefix(f'{r.name}: ')}." for r in _without_data(result)]
    others = [i for i, heading in enumerate(found.columns) if heading.spare > spare]
    if verbose:
        lines += _further_tables(found, others, names, halves, width)
    left_out = [found.columns[i].title[0].lower() + found.columns[i].title[1:] for i in others if not verbose]
    legend += [f"No room for: {', '.join(left_out)}."] if left_out else []
    return lines + [TextLine(line, "dim") for text in legend for line in textwrap.wrap(text, width)]


def _further_tables(
    found: FilterTable, others: list[int], names: Mapping[str, str], halves: bool, width: int
) -> Iterator[TextLine]:
    """Yield tables of the columns ``others``, each with as many as fit."""
    from attlog.words.table import FilterTable

    while others:
        for count in range(len(others), 0, -1):
            some = others[:count]
            part = FilterTable([found.columns[i] for i in some], [(row, [c[i] for i in some]) for row, c in found.rows])
            lines = _filter_rows(part, names, False, halves, ALL_COLUMNS, False)
            if max(len(line.text) for line in lines) <= width or count == 1:
                break
        others = others[count:]
        yield TextLine("")
        yield from lines


def _filter_rows(
    found: FilterTable, names: Mapping[str, str], ids: bool, halves: bool, spare: int, short: bool
) -> list[TextLine]:
    shown = [i for i, heading in enumerate(found.columns) if heading.spare <= spare]
    rows = []
    for row, cells in found.rows:
        name = names[row.name] + (" (reference)" if row.is_reference else "")
        rows.append([name, *([clean(row.name)] if ids else []), *(_cell_text(cells[i], halves) for i in shown)])
    first = ["filter", *(["id"] if ids else [])]
    columns = list(zip(*rows, strict=True))[len(first) :]
    head = [_heading(found.columns[i], cells, short) for i, cells in zip(shown, columns, strict=True)]
    return list(table(rows, [*first, *head], left=range(len(first))))


def _heading(heading: TableColumn, cells: Sequence[str], short: bool) -> str:
    """Break a heading into lines no wider than its cells or its longest word."""
    if short:
        return f"{heading.short} {heading.unit} ".rstrip() + " "
    width = max(map(len, [*cells, *heading.title.split()]))
    return "\n".join(textwrap.wrap(f"{heading.title} {heading.unit}".strip(), width))


def _cell_text(cell: TableCell, halves: bool) -> str:
    if cell.missing:
        return (cell.text if halves else cell.brief) + " "
    half = f" {cell.half}" if halves and cell.half else ""
    return cell.text + half + ("*" if cell.best else "~" if cell.unranked else " ")


def _without_data(result: Result) -> list[EstimatorRow]:
    """Return filters without enough data in this log, which no finding names."""
    texts = {f.text for f in result.findings if f.kind == "estimator_failed" and not f.is_trouble}
    return [row for row in result.estimators if f"{row.name}: {row.reason}" in texts]


def shortened(found: FilterTable) -> FilterTable:
    """Keep the first column of each question with a short title, for filters, what flew and the reference.

    The gyro alone appears only without other filters.
    """
    from attlog.words.ranking import is_baseline
    from attlog.words.table import FilterTable

    first: dict[str, int] = {}
    for i, heading in enumerate(found.columns):
        if heading.short:
            first.setdefault(heading.short, i)
    filters = [r.name for r, _ in found.rows if r.kind == "replay"]
    filters = [r.name for r, _ in found.rows if r.name in filters and not is_baseline(r)] or filters
    shown = [(r, c) for r, c in found.rows if r.name in [*filters, "onboard"] or r.is_reference or r.kind == "rerun"]
    return FilterTable(
        [found.columns[i] for i in first.values()], [(r, [c[i] for i in first.values()]) for r, c in shown]
    )


def _against(result: Result, caveat: bool) -> str:
    """Name what errors are against, with its caveat where no sentence above has it."""
    reference = result.reference
    if reference is None or reference.choice not in AGAINST:
        return ""
    from attlog.words.names import against_heading, truth_name

    parts = [AGAINST[reference.choice].format(truth=truth_name(result))]
    parts += [f"headings against {against_heading(result, 'onboard')}"] if reference.heading_by == "onboard" else []
    parts += [typeset(reference.caveat)] if caveat and reference.caveat else []
    return "; ".join(parts) + "."


def _legend(result: Result, found: FilterTable, halves: bool, width: int, *, caveat: bool) -> list[str]:
    """Name what errors are against and explain the marks that the table has."""
    cells = list(itertools.chain.from_iterable(row for _, row in found.rows))
    marks = {"*": any(c.best for c in cells), "~": any(c.unranked for c in cells)}
    marks["±"] = halves and any(c.half for c in cells)
    lines = textwrap.wrap(_against(result, caveat), width)
    for part in (text for mark, text in MARKS.items() if marks[mark]):
        if lines and len(lines[-1]) + len(GAP) + len(part) <= width:
            lines[-1] += GAP + part
        else:
            lines.append(part)
    return lines


def sensor_lines(checks: Sequence[Check], width: int, verbose: bool) -> Iterator[TextLine]:
    """Table of sensors that are off or may be set, faults first; the rest in a line each.

    ``verbose``: sound sensors as rows too, the evidence of each, and why others have no answer.
    """
    every = shown_checks(checks)
    ok = [a for a in every if a.verdict == "ok" and not a.listed]
    silent = [a for a in every if a.verdict == "unknown" and not a.listed]
    listed = [a for a in every if a.listed]
    yield from _sensor_table(repeat_advice_once(listed + ok if verbose else listed), width, verbose)
    if ok and not verbose:
        yield from wrapped("  ok: ", question_titles(ok), width)
    if silent and not verbose:
        yield from wrapped("  no answer: ", f"{question_titles(silent)} (why: -v)", width)
    for questions, why in reasons_unknown(silent) if verbose else ():
        yield from wrapped("  no answer: ", questions, width)
        yield from wrapped(" " * 6, why, width, "dim")
    if not every:
        yield TextLine("  No question about a sensor can be answered from this log.")


def _sensor_table(rows: Sequence[ShownCheck], width: int, verbose: bool) -> Iterator[TextLine]:
    """Sensor, question, verdict, value (below the row if there is no room); then what was found, what to set or do."""
    if not rows:
        return
    head = ("sensor", "question", "verdict", "value")
    cells = [(a.sensor, a.question, a.verdict, a.value) for a in rows]
    laid = list(table(cells, head, left=range(4), indent="  "))
    beside = len(head)
    if max(len(line.text) for line in laid) > width:
        beside -= 1
        laid = list(table([row[:beside] for row in cells], head[:beside], left=range(beside), indent="  "))
    yield laid[0]
    for a, line, row in zip(rows, laid[1:], cells, strict=True):
        yield TextLine(line.text, VERDICT_STYLES.get(a.verdict, ""))
        for text in filter(None, (*row[beside:], a.text, a.to_set)):
            yield from wrapped(" " * 4, text, width)
        for text in filter(None, a.why if verbose else ()):
            yield from wrapped(" " * 6, text, width, "dim")


def setting_lines(settings: Sequence[Setting]) -> Iterator[TextLine]:
    """Parameters to set, a line each: ``NAME old -> new``."""
    if settings:
        yield TextLine("set", "bold")
        yield from (TextLine(f"  {parameter_change(setting)}") for setting in settings)


def set_line(settings: Sequence[Setting], log: str, width: int) -> Iterator[TextLine]:
    """At most two lines of parameters to set, and the command that shows why."""
    from attlog.words.findings import parameter_changes

    width = min(width, SENTENCE_COLUMNS)
    why = f"attlog health {log} shows why."
    for most in range(len(settings), 0, -1):
        lines = list(wrapped(f"{'set':<{LABEL_COLUMNS}}", f"{parameter_changes(settings, most)}; {why}", width))
        if len(lines) <= 2 and all(len(line.text) <= width for line in lines):
            yield from lines
            return
    if settings:
        yield TextLine(f"{'set':<{LABEL_COLUMNS}}{len(settings)} parameters; attlog health shows which and why.")
