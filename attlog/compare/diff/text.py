"""A difference of two runs as text: for the terminal, as Markdown for a pull request, as JSON for machines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

from attlog.base import plain
from attlog.compare.diff.changes import ABSENT, NumberChange, RunDifference, TextChange
from attlog.compare.diff.order import ORDER, question_of, sorted_changes
from attlog.present.numbers import MINUS, counted, half_width, quantity, unit_sign
from attlog.present.table.markdown import escaped
from attlog.present.text import clean

SCHEMA = "attlog-diff/2"
MOST = 40
"""So many settings of a log, and numbers of a question in Markdown, are listed; the JSON holds all."""
FEW = 5
"""So many of each on a terminal."""
HEAD = ("row", "window", "metric", "old", "new", "difference", "tolerance", "")
SIGNS = {"appeared": "new", "vanished": "gone", "not_significant": "not significant", "within": "within"}

Table = list[tuple[str, ...]]


def document(differences: Sequence[RunDifference], alone: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """The JSON: every number that differs, and ``count`` of the differences that matter; ``alone``: (name, side)."""
    logs = []
    for d in differences:
        entry = plain.plain(asdict(d))
        logs.append(entry | {"count": d.count})
    only = {side: [name for name, s in alone if s == side] for side in ("old", "new")}
    return {"schema": SCHEMA, "count": sum(d.count for d in differences) + len(alone), "only_in": only, "logs": logs}


def lines(differences: Sequence[RunDifference], alone: Sequence[tuple[str, str]], everything: bool) -> Iterator[str]:
    """The text for a terminal, worst first; ``everything`` also lists what stays within its tolerance."""
    most = None if everything else FEW
    for d in differences:
        yield clean(f"{d.name}: {summary(d)}")
        for title, entries in before(d):
            yield from _listing(title, entries, most)
        for title, moved in by_question(d, everything):
            shown = moved[:most]
            yield f"  {title} ({len(moved)})"
            yield from (f"  {line}" for line in _aligned([row(m) for m in shown]))
            if len(shown) < len(moved):
                yield f"    and {len(moved) - len(shown)} more; -v lists all"
        for title, entries in after(d):
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
    yield from (f"    {text}" for text in _limited(texts, most))


def markdown(differences: Sequence[RunDifference], alone: Sequence[tuple[str, str]], everything: bool) -> Iterator[str]:
    """The same as Markdown."""
    most = None if everything else MOST
    for d in differences:
        yield from (f"### {escaped(d.name)}", "", escaped(summary(d)), "")
        yield from _lists(before(d), most)
        for title, moved in by_question(d, everything):
            yield from (f"**{title} ({len(moved)})**", "")
            yield "| " + " | ".join(map(escaped, HEAD)) + " |"
            yield "|" + " --- |" * 3 + " ---: |" * 4 + " --- |"
            yield from ("| " + " | ".join(map(escaped, row(m))) + " |" for m in moved[:most])
            yield ""
            if most is not None and len(moved) > most:
                yield from (f"and {len(moved) - most} more", "")
        yield from _lists(after(d), most)
    if alone:
        yield from (f"- {escaped(name)}: only in {side.upper()}" for name, side in alone)


def _lists(found: Iterable[tuple[str, list[TextChange | str]]], most: int | None) -> Iterator[str]:
    for title, entries in found:
        texts = _limited([entry_line(e) for e in entries], most)
        yield from (f"**{title}**", "", *(f"- {escaped(text)}" for text in texts), "")


def summary(d: RunDifference) -> str:
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


def before(d: RunDifference) -> Iterator[tuple[str, list[TextChange | str]]]:
    """Statements before the numbers: headline, verdicts, findings, filters that came, went or changed their state."""
    yield from _titled(
        ("Headline and findings", d.statements),
        ("Verdicts that differ", [c.name for c in d.verdicts]),
        ("Filters that vanished", d.rows_vanished),
        ("Filters that appeared", d.rows_appeared),
        ("State of filters", d.status),
    )


def after(d: RunDifference) -> Iterator[tuple[str, list[TextChange | str]]]:
    """What may be the cause, each list under its title."""
    yield from _titled(
        ("Parameters of the log", d.parameters or []), ("Filter gains", d.gains), ("Options", d.config), ("Log", d.log)
    )
    if d.parameters is None and not d.same_log:
        yield "Parameters of the log", ["not compared: a result was written before results held them; analyse it again"]


def _titled(*lists: tuple[str, Sequence[TextChange | str]]) -> Iterator[tuple[str, list[TextChange | str]]]:
    yield from ((f"{title} ({len(found)})", list(found)) for title, found in lists if found)


def by_question(d: RunDifference, everything: bool = False) -> list[tuple[str, list[NumberChange]]]:
    """The numbers that count under their questions, in the order of the difference; ``everything``: all that moved."""
    groups: dict[str, list[NumberChange]] = {}
    for m in sorted_changes(d.moved) if everything else d.beyond:
        groups.setdefault(question_of(m.metric), []).append(m)
    return [(title, groups[title]) for title in ORDER if title in groups]


def row(m: NumberChange) -> tuple[str, ...]:
    """A number that moved as the cells of HEAD; the last says which way it counts."""
    sign = SIGNS.get(m.verdict, "")
    if m.verdict == "beyond":
        sign = "" if m.closer is None else "better" if m.closer else "worse"
    sides = [_value(v, c, m.unit) for v, c in ((m.old, m.old_ci95), (m.new, m.new_ci95))]
    return m.row, m.window, m.metric, *sides, _size(m.difference, m.unit, "+"), _size(m.tolerance, m.unit, ""), sign


def _size(value: float | None, unit: str, plus: str) -> str:
    """A difference to three digits: those of values would show a small one as 0."""
    if value is None:
        return ""
    sign = unit_sign(unit)
    text = f"{value:{plus}.3g}".replace("-", MINUS, 1) if "e" not in f"{value:.3g}" else f"{value:{plus}.3g}"
    return text + sign if sign.startswith("°") else f"{text} {sign}".rstrip()


def _value(value: float | None, ci95: tuple[float, float] | None, unit: str) -> str:
    if value is None:
        return "none"
    return " ".join(x for x in (quantity(value, unit, signed=None), half_width(ci95, unit)) if x)


def entry_line(entry: TextChange | str) -> str:
    if isinstance(entry, str):
        return clean(entry)
    ends = entry.old, entry.new
    sides = ["absent" if x == ABSENT else f"{x:.7g}" if isinstance(x, float) else str(x) or "none" for x in ends]
    if sides[0] == sides[1]:  # what differs is behind the digits shown
        sides = [repr(x) for x in ends]
    return clean(f"{entry.name}: {sides[0]} → {sides[1]}")


def _limited(texts: list[str], most: int | None) -> list[str]:
    if most is None or len(texts) <= most + 1:
        return texts
    return [*texts[:most], f"and {len(texts) - most} more; -v lists all"]


def _aligned(rows: Table) -> Iterable[str]:
    """Columns under each other: names to the left, numbers to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    for r in rows:
        cells = (
            c.ljust(w) if i < 3 or i == len(HEAD) - 1 else c.rjust(w)
            for i, (c, w) in enumerate(zip(r, widths, strict=True))
        )
        yield "  " + "  ".join(cells).rstrip()
