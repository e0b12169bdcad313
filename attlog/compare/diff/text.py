"""A difference of two runs as text: for the terminal, as Markdown for a pull request, as JSON for machines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

from attlog.base import plain
from attlog.compare.diff.diff import ABSENT, NumberChange, RunDifference, TextChange
from attlog.present.numbers import MINUS, counted, half_width, quantity, unit_sign
from attlog.present.table.markdown import escaped
from attlog.present.text import clean

SCHEMA = "attlog-diff/2"
MOST = 40
"""So many numbers and settings of a log are listed; the JSON holds all."""
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
    """The text for a terminal; ``everything`` also lists what stays within its tolerance."""
    for d in differences:
        yield clean(f"{d.name}: {summary(d)}")
        for title, entries in _settings(d):
            yield f"  {title}"
            yield from (f"    {text}" for text in _limited([_entry_line(e) for e in entries], everything))
        rows, left = _numbers(d, everything)
        yield from _aligned(rows)
        if left:
            yield f"  and {left} more; -v lists all, --format json holds all"
    for name, side in alone:
        yield clean(f"{name}: only in {side.upper()}")


def markdown(differences: Sequence[RunDifference], alone: Sequence[tuple[str, str]], everything: bool) -> Iterator[str]:
    """The same as Markdown."""
    for d in differences:
        yield from (f"### {escaped(d.name)}", "", escaped(summary(d)), "")
        for title, entries in _settings(d):
            texts = _limited([_entry_line(e) for e in entries], everything)
            yield from (f"**{title}**", "", *(f"- {escaped(text)}" for text in texts), "")
        rows, left = _numbers(d, everything)
        if len(rows) > 1:
            yield "| " + " | ".join(map(escaped, rows[0])) + " |"
            yield "|" + " --- |" * 3 + " ---: |" * 4 + " --- |"
            yield from ("| " + " | ".join(map(escaped, row)) + " |" for row in rows[1:])
            yield ""
        if left:
            yield from (f"and {left} more", "")
    if alone:
        yield from (f"- {escaped(name)}: only in {side.upper()}" for name, side in alone)


def summary(d: RunDifference) -> str:
    """What was compared and how much differs, in one sentence."""
    versions = [e.old if e.old == e.new else f"{e.old} → {e.new}" for e in d.made_by]
    what = "the same log" if d.same_log else "two logs"
    by = f", attlog {versions[0]}" if versions else ""
    within = sum(m.verdict == "within" for m in d.moved)
    unsure = sum(m.verdict == "not_significant" for m in d.moved)
    total = d.equal + len(d.moved)
    parts = [f"{counted(len(d.beyond), 'value')} of {total:,} beyond tolerance"]
    parts += [f"{within:,} within"] if within else []
    parts += [f"{unsure:,} not significant by their intervals"] if unsure else []
    more = d.count - len(d.beyond)
    parts += [f"{counted(more, 'row')} appeared, vanished or of another state"] if more else []
    return f"{what}{by}: {', '.join(parts)}" if d.moved or more else f"{what}{by}: no difference in {total:,} values"


def _settings(d: RunDifference) -> Iterator[tuple[str, list[TextChange | str]]]:
    """What differs beside the numbers, each list under its title."""
    lists: tuple[tuple[str, Sequence[TextChange | str]], ...] = (
        ("log", d.log),
        ("options", d.config),
        ("parameters of the log", d.parameters or []),
        ("filter gains", d.gains),
        ("rows that appeared", d.rows_appeared),
        ("rows that vanished", d.rows_vanished),
        ("state of rows", d.status),
    )
    yield from ((f"{title} ({len(found)})", list(found)) for title, found in lists if found)
    if d.parameters is None and not d.same_log:
        yield "parameters of the log", ["not compared: a result was written before results held them; analyse it again"]


def _numbers(d: RunDifference, everything: bool) -> tuple[Table, int]:
    """The table with its heading, and how many numbers it leaves out."""
    counting = {id(m) for m in d.beyond}
    chosen = d.moved if everything else [m for m in d.moved if id(m) in counting]
    ordered = sorted(chosen, key=lambda m: id(m) not in counting)
    shown = ordered if everything else ordered[:MOST]
    return [HEAD, *(_row(m, id(m) in counting) for m in shown)] if shown else [], len(ordered) - len(shown)


def _row(m: NumberChange, counts: bool) -> tuple[str, ...]:
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


def _entry_line(entry: TextChange | str) -> str:
    if isinstance(entry, str):
        return clean(entry)
    ends = entry.old, entry.new
    sides = ["absent" if x == ABSENT else f"{x:.7g}" if isinstance(x, float) else str(x) or "none" for x in ends]
    if sides[0] == sides[1]:  # what differs is behind the digits shown
        sides = [repr(x) for x in ends]
    return clean(f"{entry.name}: {sides[0]} → {sides[1]}")


def _limited(texts: list[str], everything: bool) -> list[str]:
    if everything or len(texts) <= MOST:
        return texts
    return [*texts[:MOST], f"and {len(texts) - MOST} more; -v lists all, --format json holds all"]


def _aligned(rows: Table) -> Iterable[str]:
    """Columns under each other: names to the left, numbers to the right."""
    if not rows:
        return []
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    cells = [
        [
            c.ljust(w) if i < 3 or i == len(HEAD) - 1 else c.rjust(w)
            for i, (c, w) in enumerate(zip(r, widths, strict=True))
        ]
        for r in rows
    ]
    return ["  " + "  ".join(row).rstrip() for row in cells]
