"""Changes between two results as terminal text, Markdown, JSON and page."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any, NamedTuple

from attlog.compare.diff import ABSENT_VALUE, QUESTION_ORDER, NumberChange, RunDifference, TextChange
from attlog.compare.tables import WEB_FOLDER, table_markdown
from attlog.core.plain import json_text, to_plain
from attlog.report import shell
from attlog.words.numbers import MINUS, counted, half_width, quantity, unit_sign
from attlog.words.text import clean, escape_markdown

DIFF_SCHEMA = "attlog-diff/2"
# Entries listed in Markdown and on a terminal. The JSON lists all.
MAX_LISTED, MAX_TERMINAL = 40, 5
# Numbers of a question shown initially on the page: the main ones, within these limits.
MIN_NUMBERS_SHOWN, MAX_NUMBERS_SHOWN = 2, 8
NUMBER_COLUMNS = ("row", "window", "metric", "old", "new", "difference", "tolerance", "")
VERDICT_SIGNS = {"appeared": "new", "vanished": "gone", "not_significant": "not significant", "within": "within"}
SENTENCE_END = re.compile(r"(?<=[.;]) (?![^(]*\))")
NO_PARAMETERS = "not compared: a result was written before results held them; analyse it again"

Alone = Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class DiffBlock:
    """A heading with entries (names, or changes of texts) or with numbers."""

    title: str
    entries: Sequence[TextChange | str] = ()
    numbers: Sequence[NumberChange] = ()

    @property
    def heading(self) -> str:
        """Return the title with the number of entries."""
        return f"{self.title} ({len(self.entries) or len(self.numbers)})"


class DiffBlocks(NamedTuple):
    """Blocks of two results: statements, numbers by question, possible causes."""

    before: list[DiffBlock]
    numbers: list[DiffBlock]
    causes: list[DiffBlock]


def diff_blocks(d: RunDifference, everything: bool = False) -> DiffBlocks:
    """Return the non-empty blocks; ``everything``: with numbers within tolerance."""
    moved = d.moved if everything else d.beyond
    unknown = d.parameters is None and not d.same_log
    found = DiffBlocks(
        [
            DiffBlock("Compared with different references", d.references),
            DiffBlock("Headline and findings", d.statements),
            DiffBlock("Verdicts that differ", [c.name for c in d.verdicts]),
            DiffBlock("Filters that vanished", d.rows_vanished),
            DiffBlock("Filters that appeared", d.rows_appeared),
            DiffBlock("State of filters", d.status),
        ],
        [DiffBlock(title, numbers=[m for m in moved if m.question == title]) for title in QUESTION_ORDER],
        [
            DiffBlock("Parameters of the log", [NO_PARAMETERS] if unknown else d.parameters or []),
            DiffBlock("Filter gains", d.gains),
            DiffBlock("Options", d.config),
            DiffBlock("Log", d.log),
        ],
    )
    return DiffBlocks(*([block for block in some if block.entries or block.numbers] for some in found))


def diff_document(differences: Sequence[RunDifference], alone: Alone) -> dict[str, Any]:
    """Return the JSON of all numbers that differ.

    ``count``: number of differences that count. ``alone``: (name, side) of logs without a partner.
    """
    logs = [to_plain(asdict(d)) | {"count": d.count} for d in differences]
    only = {side: [name for name, s in alone if s == side] for side in ("old", "new")}
    return {
        "schema": DIFF_SCHEMA,
        "count": sum(d.count for d in differences) + len(alone),
        "only_in": only,
        "logs": logs,
    }


def diff_lines(differences: Sequence[RunDifference], alone: Alone, everything: bool) -> Iterator[str]:
    """Return terminal lines, worst first; ``everything``: with numbers within tolerance."""
    most = None if everything else MAX_TERMINAL
    for d in differences:
        yield clean(f"{d.name}: {diff_summary(d)}")
        for block in chain(*diff_blocks(d, everything)):
            if block.entries and all(isinstance(e, str) for e in block.entries):
                yield f"  {block.heading}: {', '.join(map(entry_line, block.entries))}"
                continue
            rows = _aligned([number_cells(m) for m in block.numbers[:most]])
            yield f"  {block.heading}"
            yield from (f"    {text}" for text in (*rows, *_listed(block, most)))
    yield from (clean(f"{name}: only in {side.upper()}") for name, side in alone)


def diff_markdown(differences: Sequence[RunDifference], alone: Alone, everything: bool) -> Iterator[str]:
    """Return the changes as Markdown; arguments as :func:`diff_lines`."""
    most = None if everything else MAX_LISTED
    for d in differences:
        yield from (f"### {escape_markdown(d.name)}", "", escape_markdown(diff_summary(d)), "")
        for block in chain(*diff_blocks(d, everything)):
            yield from (f"**{block.heading}**", "")
            if block.numbers:
                cells = [number_cells(m) for m in block.numbers[:most]]
                yield table_markdown(NUMBER_COLUMNS, cells)
            bullet = "" if block.numbers else "- "
            yield from (*(f"{bullet}{escape_markdown(text)}" for text in _listed(block, most)), "")
    yield from (f"- {escape_markdown(name)}: only in {side.upper()}" for name, side in alone)


def diff_summary(d: RunDifference) -> str:
    """Summarise in one sentence: results compared and number of differences."""
    versions = [e.old if e.old == e.new else f"{e.old} → {e.new}" for e in d.made_by]
    what = "the same log" if d.same_log else "two logs"
    by = f", attlog {versions[0]}" if versions else ""
    by += "".join(f", compared with {c.old} → {c.new}, so no value is better or worse" for c in d.references)
    total, more = d.equal + len(d.moved), d.count - len(d.beyond)
    if not d.moved and not more:
        return f"{what}{by}: no difference in {total:,} numbers"
    parts = [f"{len(d.beyond):,} of {counted(total, 'number')} beyond tolerance", *_quiet_parts(d, "within")]
    parts += [f"{counted(more, 'filter')} came, went or changed state"] if more else []
    return f"{what}{by}: {', '.join(parts)}"


def _quiet_parts(d: RunDifference, within: str) -> list[str]:
    verdicts = [m.verdict for m in d.moved]
    counts = ((verdicts.count("within"), within), (verdicts.count("not_significant"), "not significant"))
    return [f"{n:,} {word}" for n, word in counts if n]


def number_cells(m: NumberChange) -> tuple[str, ...]:
    """Return a changed number as cells of NUMBER_COLUMNS; the last is its side."""
    sign = VERDICT_SIGNS.get(m.verdict, "")
    if m.verdict == "beyond":
        sign = "" if m.closer is None else "better" if m.closer else "worse"
    sides = [_value_text(v, c, m.unit) for v, c in ((m.old, m.old_ci95), (m.new, m.new_ci95))]
    sizes = _size_text(m.difference, m.unit, "+"), _size_text(m.tolerance, m.unit, "")
    return m.row, m.window, m.metric, *sides, *sizes, sign


def _size_text(value: float | None, unit: str, plus: str) -> str:
    """Format a difference with three digits."""
    if value is None:
        return ""
    sign = unit_sign(unit)
    text = f"{value:{plus}.3g}"
    text = text if "e" in text else text.replace("-", MINUS, 1)
    return text + sign if sign.startswith("°") else f"{text} {sign}".rstrip()


def _value_text(value: float | None, ci95: tuple[float, float] | None, unit: str) -> str:
    if value is None:
        return "none"
    return " ".join(x for x in (quantity(value, unit, signed=None), half_width(ci95, unit)) if x)


def entry_line(entry: TextChange | str) -> str:
    """Return a change of a text as ``name: old → new``."""
    if isinstance(entry, str):
        return clean(entry)
    ends = entry.old, entry.new
    sides = ["absent" if x == ABSENT_VALUE else f"{x:.7g}" if isinstance(x, float) else str(x) or "none" for x in ends]
    if sides[0] == sides[1]:  # both sides are equal in the digits shown
        sides = [repr(x) for x in ends]
    return clean(f"{entry.name}: {sides[0]} → {sides[1]}")


def _listed(block: DiffBlock, most: int | None) -> list[str]:
    """Return the listed entries of a block (no numbers) and how many are omitted."""
    texts, total = [entry_line(e) for e in block.entries], len(block.entries) or len(block.numbers)
    if most is None or total <= most + (not block.numbers):
        return texts
    return [*texts[:most], f"and {total - most} more; -v lists all"]


def _aligned(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Return rows in columns: names to the left, numbers to the right."""
    adjust = [str.ljust] * 3 + [str.rjust] * 4 + [str.ljust]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(to(c, w) for to, c, w in zip(adjust, row, widths, strict=True)).rstrip()


def diff_page(
    differences: Sequence[RunDifference], alone: Alone, old: str, new: str, version: str, command: str
) -> str:
    """Return the page, worst first.

    ``old``, ``new``: names of both sides. ``alone``: logs of one side.
    """
    whole = diff_document(differences, alone)
    return shell.render(
        "diff.html",
        WEB_FOLDER,
        rows=[],
        figures=[],
        document=json_text(whole),
        styles=("diff.css",),
        sections=[_page_section(d) for d in sorted(differences, key=lambda d: -d.count)],
        alone=alone,
        old=old,
        new=new,
        count=whole["count"],
        version=version,
        command=command,
    )


def _page_section(d: RunDifference) -> dict[str, Any]:
    """Return the template's variables for a pair of results."""
    before, numbers, causes = diff_blocks(d)
    tables = []
    for block in numbers:
        main = sum(m.is_main for m in block.numbers)
        shown = min(max(main, MIN_NUMBERS_SHOWN), MAX_NUMBERS_SHOWN)
        cells = [_page_cells(m) for m in block.numbers]
        tables.append((block.title, cells[:shown], cells[shown:]))
    # the summary has the references; statements and verdicts are shown side by side
    lists = before[bool(d.references) + bool(d.statements) + bool(d.verdicts) :]
    quiet = [*_quiet_parts(d, "within tolerance"), *([f"{d.equal:,} equal"] if d.equal else [])]
    return {
        "name": d.name,
        "summary": diff_summary(d),
        "count": d.count,
        "statements": [
            TextChange(c.name, _first_sentence(c.old), _first_sentence(c.new)) for c in (*d.statements, *d.verdicts)
        ],
        "lists": [(block.heading, list(map(entry_line, block.entries))) for block in lists],
        "tables": tables,
        "causes": [(block.heading, list(map(entry_line, block.entries))) for block in causes],
        "quiet": ", ".join(quiet),
    }


def _first_sentence(value: Any) -> str:
    return "none" if value in (ABSENT_VALUE, "") else SENTENCE_END.split(str(value))[0]


def _page_cells(m: NumberChange) -> list[str]:
    """Return title and id of the metric, filter, window, both values, change, tolerance, side."""
    name, window, metric, old, new, change, tolerance, sign = number_cells(m)
    return [m.title, metric, name, window, old, new, change or m.reason, tolerance, sign]
