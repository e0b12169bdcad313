"""The page of a difference: statements that differ, then numbers by question, then causes; worst first."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from attlog.compare.diff.changes import ABSENT, NumberChange, RunDifference, TextChange
from attlog.compare.diff.order import is_main, title_of
from attlog.compare.diff.text import after, before, by_question, document, entry_line, row, summary
from attlog.report import shell
from attlog.report.pack import Store

SENTENCE = re.compile(r"(?<=[.;]) (?![^(]*\))")
OWN = Path(__file__).parents[1] / "web"
FEWEST, SHOWN = 2, 8
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
    sections = sorted(map(_section, differences), key=lambda s: -s.count)
    whole: dict[str, Any] = document(differences, alone)
    return shell.render(
        "diff.html",
        OWN,
        rows=[],
        figures=[],
        store=Store(),
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


def _section(d: RunDifference) -> DiffSection:
    shown = []
    for title, moved in by_question(d):
        most = min(max(sum(map(is_main, moved)), FEWEST), SHOWN)
        shown.append((title, moved[:most], moved[most:]))
    within = sum(m.verdict == "within" for m in d.moved)
    unsure = sum(m.verdict == "not_significant" for m in d.moved)
    quiet = [f"{within:,} within tolerance"] if within else []
    quiet += [f"{unsure:,} not significant"] if unsure else []
    quiet += [f"{d.equal:,} equal"] if d.equal else []
    own = bool(d.statements) + bool(d.verdicts)
    lists = [(title, _lines(entries)) for title, entries in before(d)][own:]
    return DiffSection(
        d.name,
        summary(d),
        d.count,
        [TextChange(c.name, _side(c.old), _side(c.new)) for c in (*d.statements, *d.verdicts)],
        lists,
        [(title, [_cells(m) for m in some], [_cells(m) for m in rest]) for title, some, rest in shown],
        [(title, _lines(entries)) for title, entries in after(d)],
        ", ".join(quiet),
    )


def _side(value: Any) -> str:
    """The first sentence of what one side tells."""
    return "none" if value in (ABSENT, "") else SENTENCE.split(str(value))[0]


def _lines(entries: Sequence[TextChange | str]) -> list[str]:
    return [entry_line(e) for e in entries]


def _cells(m: NumberChange) -> list[str]:
    """Title and id of the metric, filter, window, both values, the change, the tolerance and which way it counts."""
    name, window, metric, old, new, change, tolerance, sign = row(m)
    return [title_of(metric), metric, name, window, old, new, change or m.reason, tolerance, sign]
