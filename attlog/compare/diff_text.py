"""A difference of two runs as text: for the terminal, as Markdown for a pull request, as JSON for machines."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from attlog.compare.diff import (
    ABSENT_VALUE,
    QUESTION_ORDER,
    NumberChange,
    RunDifference,
    TextChange,
    is_main_number,
    metric_question,
    metric_title,
    sorted_changes,
)
from attlog.core import plain
from attlog.report import shell
from attlog.report.bundle import ArrayPacker
from attlog.words.numbers import MINUS, counted, half_width, quantity, unit_sign
from attlog.words.text import clean, escape_markdown

DIFF_SCHEMA = "attlog-diff/2"
MAX_LISTED = 40
"""So many settings of a log, and numbers of a question in Markdown, are listed; the JSON holds all."""
MAX_TERMINAL = 5
"""So many of each on a terminal."""
NUMBER_COLUMNS = ("row", "window", "metric", "old", "new", "difference", "tolerance", "")
VERDICT_SIGNS = {"appeared": "new", "vanished": "gone", "not_significant": "not significant", "within": "within"}

Table = list[tuple[str, ...]]


def diff_document(differences: Sequence[RunDifference], alone: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """The JSON: every number that differs, and ``count`` of the differences that matter; ``alone``: (name, side)."""
    logs = []
    for d in differences:
        entry = plain.to_plain(asdict(d))
        logs.append(entry | {"count": d.count})
    only = {side: [name for name, s in alone if s == side] for side in ("old", "new")}
    return {
        "schema": DIFF_SCHEMA,
        "count": sum(d.count for d in differences) + len(alone),
        "only_in": only,
        "logs": logs,
    }


def diff_lines(
    differences: Sequence[RunDifference], alone: Sequence[tuple[str, str]], everything: bool
) -> Iterator[str]:
    """The text for a terminal, worst first; ``everything`` also lists what stays within its tolerance."""
    most = None if everything else MAX_TERMINAL
    for d in differences:
        yield clean(f"{d.name}: {diff_summary(d)}")
        for title, entries in lists_before(d):
            yield from _listing(title, entries, most)
        for title, moved in numbers_by_question(d, everything):
            shown = moved[:most]
            yield f"  {title} ({len(moved)})"
            yield from (f"  {line}" for line in _aligned([number_cells(m) for m in shown]))
            if len(shown) < len(moved):
                yield f"    and {len(moved) - len(shown)} more; -v lists all"
        for title, entries in lists_after(d):
            yield from _listing(title, entries, most)
    for name, side in alone:
        yield clean(f"{name}: only in {side.upper()}")


def _listing(title: str, entries: Sequence[TextChange | str], most: int | None) -> Iterator[str]:
    """Names on one line, changes on one each."""
    texts = [entry_line(e) for e in entries]
    if all(isinstance(e, str) for e in entries):
        yield f"  {title}: {', '.join(texts)}"
        return
    yield f"  {title}"
    yield from (f"    {text}" for text in _limit_list(texts, most))


def diff_markdown(
    differences: Sequence[RunDifference], alone: Sequence[tuple[str, str]], everything: bool
) -> Iterator[str]:
    """The same as Markdown."""
    most = None if everything else MAX_LISTED
    for d in differences:
        yield from (f"### {escape_markdown(d.name)}", "", escape_markdown(diff_summary(d)), "")
        yield from _markdown_lists(lists_before(d), most)
        for title, moved in numbers_by_question(d, everything):
            yield from (f"**{title} ({len(moved)})**", "")
            yield "| " + " | ".join(map(escape_markdown, NUMBER_COLUMNS)) + " |"
            yield "|" + " --- |" * 3 + " ---: |" * 4 + " --- |"
            yield from ("| " + " | ".join(map(escape_markdown, number_cells(m))) + " |" for m in moved[:most])
            yield ""
            if most is not None and len(moved) > most:
                yield from (f"and {len(moved) - most} more", "")
        yield from _markdown_lists(lists_after(d), most)
    if alone:
        yield from (f"- {escape_markdown(name)}: only in {side.upper()}" for name, side in alone)


def _markdown_lists(found: Iterable[tuple[str, list[TextChange | str]]], most: int | None) -> Iterator[str]:
    for title, entries in found:
        texts = _limit_list([entry_line(e) for e in entries], most)
        yield from (f"**{title}**", "", *(f"- {escape_markdown(text)}" for text in texts), "")


def diff_summary(d: RunDifference) -> str:
    """What was compared and how much differs, in one sentence."""
    versions = [e.old if e.old == e.new else f"{e.old} → {e.new}" for e in d.made_by]
    what = "the same log" if d.same_log else "two logs"
    by = f", attlog {versions[0]}" if versions else ""
    within = sum(m.verdict == "within" for m in d.moved)
    unsure = sum(m.verdict == "not_significant" for m in d.moved)
    total = d.equal + len(d.moved)
    parts = [f"{len(d.beyond):,} of {counted(total, 'number')} beyond tolerance"]
    parts += [f"{within:,} within"] if within else []
    parts += [f"{unsure:,} not significant"] if unsure else []
    more = d.count - len(d.beyond)
    parts += [f"{counted(more, 'filter')} came, went or changed state"] if more else []
    return f"{what}{by}: {', '.join(parts)}" if d.moved or more else f"{what}{by}: no difference in {total:,} numbers"


def lists_before(d: RunDifference) -> Iterator[tuple[str, list[TextChange | str]]]:
    """Statements before the numbers: headline, verdicts, findings, filters that came, went or changed their state."""
    yield from _titled_lists(
        ("Headline and findings", d.statements),
        ("Verdicts that differ", [c.name for c in d.verdicts]),
        ("Filters that vanished", d.rows_vanished),
        ("Filters that appeared", d.rows_appeared),
        ("State of filters", d.status),
    )


def lists_after(d: RunDifference) -> Iterator[tuple[str, list[TextChange | str]]]:
    """What may be the cause, each list under its title."""
    yield from _titled_lists(
        ("Parameters of the log", d.parameters or []), ("Filter gains", d.gains), ("Options", d.config), ("Log", d.log)
    )
    if d.parameters is None and not d.same_log:
        yield "Parameters of the log", ["not compared: a result was written before results held them; analyse it again"]


def _titled_lists(*lists: tuple[str, Sequence[TextChange | str]]) -> Iterator[tuple[str, list[TextChange | str]]]:
    yield from ((f"{title} ({len(found)})", list(found)) for title, found in lists if found)


def numbers_by_question(d: RunDifference, everything: bool = False) -> list[tuple[str, list[NumberChange]]]:
    """The numbers that count under their questions, in the order of the difference; ``everything``: all that moved."""
    groups: dict[str, list[NumberChange]] = {}
    for m in sorted_changes(d.moved) if everything else d.beyond:
        groups.setdefault(metric_question(m.metric), []).append(m)
    return [(title, groups[title]) for title in QUESTION_ORDER if title in groups]


def number_cells(m: NumberChange) -> tuple[str, ...]:
    """A number that moved as the cells of HEAD; the last says which way it counts."""
    sign = VERDICT_SIGNS.get(m.verdict, "")
    if m.verdict == "beyond":
        sign = "" if m.closer is None else "better" if m.closer else "worse"
    sides = [_value_text(v, c, m.unit) for v, c in ((m.old, m.old_ci95), (m.new, m.new_ci95))]
    return (
        m.row,
        m.window,
        m.metric,
        *sides,
        _size_text(m.difference, m.unit, "+"),
        _size_text(m.tolerance, m.unit, ""),
        sign,
    )


def _size_text(value: float | None, unit: str, plus: str) -> str:
    """A difference to three digits: those of values would show a small one as 0."""
    if value is None:
        return ""
    sign = unit_sign(unit)
    text = f"{value:{plus}.3g}".replace("-", MINUS, 1) if "e" not in f"{value:.3g}" else f"{value:{plus}.3g}"
    return text + sign if sign.startswith("°") else f"{text} {sign}".rstrip()


def _value_text(value: float | None, ci95: tuple[float, float] | None, unit: str) -> str:
    if value is None:
        return "none"
    return " ".join(x for x in (quantity(value, unit, signed=None), half_width(ci95, unit)) if x)


def entry_line(entry: TextChange | str) -> str:
    if isinstance(entry, str):
        return clean(entry)
    ends = entry.old, entry.new
    sides = ["absent" if x == ABSENT_VALUE else f"{x:.7g}" if isinstance(x, float) else str(x) or "none" for x in ends]
    if sides[0] == sides[1]:  # what differs is behind the digits shown
        sides = [repr(x) for x in ends]
    return clean(f"{entry.name}: {sides[0]} → {sides[1]}")


def _limit_list(texts: list[str], most: int | None) -> list[str]:
    if most is None or len(texts) <= most + 1:
        return texts
    return [*texts[:most], f"and {len(texts) - most} more; -v lists all"]


def _aligned(rows: Table) -> Iterable[str]:
    """Columns under each other: names to the left, numbers to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(NUMBER_COLUMNS))]
    for r in rows:
        cells = (
            c.ljust(w) if i < 3 or i == len(NUMBER_COLUMNS) - 1 else c.rjust(w)
            for i, (c, w) in enumerate(zip(r, widths, strict=True))
        )
        yield "  " + "  ".join(cells).rstrip()


# The page of a difference: statements that differ, then numbers by question, then causes; worst first.

SENTENCE_END = re.compile(r"(?<=[.;]) (?![^(]*\))")
WEB_FOLDER = Path(__file__).parent / "web"
MIN_NUMBERS_SHOWN, MAX_NUMBERS_SHOWN = 2, 8
"""Of a question the numbers that a comparison asks for are shown at first: so many at least, so many at most."""


@dataclass(frozen=True, slots=True)
class DiffSection:
    """One pair of results: ``statements`` and ``lists`` before the numbers, ``tables`` by question (rows shown at
    first, the others), ``causes``; ``quiet`` says what stays within its tolerance."""

    name: str
    summary: str
    count: int
    statements: list[TextChange]
    lists: list[tuple[str, list[str]]]
    tables: list[tuple[str, list[list[str]], list[list[str]]]]
    causes: list[tuple[str, list[str]]]
    quiet: str


def diff_page(
    differences: Sequence[RunDifference],
    alone: Sequence[tuple[str, str]],
    old: str,
    new: str,
    version: str,
    command: str,
) -> str:
    """The page as text. ``old``, ``new``: what both sides are called; ``alone``: logs of one side, as (name, side)."""
    sections = sorted(map(_diff_section, differences), key=lambda s: -s.count)
    whole: dict[str, Any] = diff_document(differences, alone)
    return shell.render(
        "diff.html",
        WEB_FOLDER,
        rows=[],
        figures=[],
        store=ArrayPacker(),
        document=whole,
        styles=("diff.css",),
        sections=sections,
        alone=alone,
        old=old,
        new=new,
        count=whole["count"],
        version=version,
        command=command,
    )


def _diff_section(d: RunDifference) -> DiffSection:
    shown = []
    for title, moved in numbers_by_question(d):
        most = min(max(sum(map(is_main_number, moved)), MIN_NUMBERS_SHOWN), MAX_NUMBERS_SHOWN)
        shown.append((title, moved[:most], moved[most:]))
    within = sum(m.verdict == "within" for m in d.moved)
    unsure = sum(m.verdict == "not_significant" for m in d.moved)
    quiet = [f"{within:,} within tolerance"] if within else []
    quiet += [f"{unsure:,} not significant"] if unsure else []
    quiet += [f"{d.equal:,} equal"] if d.equal else []
    own = bool(d.statements) + bool(d.verdicts)
    lists = [(title, _entry_lines(entries)) for title, entries in lists_before(d)][own:]
    return DiffSection(
        d.name,
        diff_summary(d),
        d.count,
        [TextChange(c.name, _first_sentence(c.old), _first_sentence(c.new)) for c in (*d.statements, *d.verdicts)],
        lists,
        [(title, [_page_cells(m) for m in some], [_page_cells(m) for m in rest]) for title, some, rest in shown],
        [(title, _entry_lines(entries)) for title, entries in lists_after(d)],
        ", ".join(quiet),
    )


def _first_sentence(value: Any) -> str:
    """The first sentence of what one side tells."""
    return "none" if value in (ABSENT_VALUE, "") else SENTENCE_END.split(str(value))[0]


def _entry_lines(entries: Sequence[TextChange | str]) -> list[str]:
    return [entry_line(e) for e in entries]


def _page_cells(m: NumberChange) -> list[str]:
    """Title and id of the metric, filter, window, both values, the change, the tolerance and which way it counts."""
    name, window, metric, old, new, change, tolerance, sign = number_cells(m)
    return [metric_title(metric), metric, name, window, old, new, change or m.reason, tolerance, sign]
