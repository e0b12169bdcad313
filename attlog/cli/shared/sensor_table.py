"""The assessments of sensors on a terminal: the table of ``attlog health``, and the line that ``analyze`` adds."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from attlog.cli.shared.printing import SENTENCES, TextLine, columns, wrapped
from attlog.present.health import ShownAssessment, change, shown_assessments

if TYPE_CHECKING:
    from attlog.result import Assessment, Setting

STYLES = {"fault": "red", "warning": "yellow"}
BESIDE = 45
"""What should be set stands beside the values where so many columns are left for it, else below them."""
LABEL = 10
"""Columns of what a line is about, as of the findings and answers of ``analyze``."""

Shown = Callable[[str], str]
"""A text as the output can show it."""


def sensor_lines(health: Sequence[Assessment], shown: Shown, width: int, verbose: bool) -> Iterator[TextLine]:
    """The table of what is off or may be set, faults first; what is ok and what cannot be told in a line each, with the
    number of sensors where there are several.

    ``verbose``: every assessment with its sentence and evidence.
    """
    every = shown_assessments(health)
    listed = [a for a in every if verbose or a.verdict in STYLES or a.offers]
    yield from _table(listed, shown, width, verbose)
    rest = [a for a in every if a not in listed]
    for label, verdict, more in (("ok", "ok", ""), ("cannot tell", "unknown", " (why: -v)")):
        times = Counter(a.question for a in rest if a.verdict == verdict)
        if times:
            text = ", ".join(f"{question} ({n})" if n > 1 else question for question, n in times.items())
            yield from wrapped(f"  {label}: ", shown(f"{text}{more}"), width)
    if not every:
        yield TextLine("  No question about a sensor can be answered from this log.")


def setting_lines(settings: Sequence[Setting]) -> Iterator[TextLine]:
    """What should be set, a line each: ``NAME old -> new``."""
    if settings:
        yield TextLine("set", "bold")
        yield from (TextLine(f"  {change(setting)}") for setting in settings)


def set_line(settings: Sequence[Setting], log: str, width: int) -> Iterator[TextLine]:
    """At most two lines of what should be set, and which command shows why; none where there is nothing."""
    from attlog.present.health import changes

    width = min(width, SENTENCES)
    why = f"attlog health {log} shows why."
    for most in range(len(settings), 0, -1):
        lines = list(wrapped(f"{'set':<{LABEL}}", f"{changes(settings, most)}; {why}", width))
        if len(lines) <= 2 and all(len(line.text) <= width for line in lines):
            yield from lines
            return
    if settings:
        yield TextLine(f"{'set':<{LABEL}}{len(settings)} parameters; attlog health shows which and why.")


def _table(rows: Sequence[ShownAssessment], shown: Shown, width: int, verbose: bool) -> Iterator[TextLine]:
    """A row for each: sensor, question, verdict, value, what to set; ``verbose``: below it what else is known."""
    if not rows:
        return
    head = ("sensor", "question", "verdict", "value", "to set")
    cells = [tuple(shown(text) for text in (a.sensor, a.question, a.verdict, a.value)) for a in rows]
    before = 2 + sum(max(len(row[i]) for row in (head, *cells)) + 2 for i in range(4))
    beside = width - before >= BESIDE
    ends = [shown(text) for text in _ends(rows, verbose)]
    laid = columns([head, *((*c, end if beside else "") for c, end in zip(cells, ends, strict=True))], width)
    yield from (TextLine(line.rstrip() if beside else line[:before].rstrip(), "bold") for line in laid[0])
    for assessment, lines, end in zip(rows, laid[1:], ends, strict=True):
        style = STYLES.get(assessment.verdict, "")
        yield from (TextLine(line, style) for line in lines)
        if end and not beside:
            yield from (TextLine(line.text, style) for line in wrapped(" " * 4, end, width))
        for sentence in assessment.why if verbose else ():
            room = max(min(width, SENTENCES) - 6, 20)
            folded = textwrap.wrap(shown(sentence), room, break_long_words=False, break_on_hyphens=False)
            yield from (TextLine(" " * 6 + line, "dim") for line in folded)


def _ends(rows: Sequence[ShownAssessment], verbose: bool) -> Iterator[str]:
    """The last cell of each row: what to set, why there is nothing, else what was found.

    What a question says of several sensors alike stands once.
    """
    said: dict[tuple[str, str], str] = {}
    for row in rows:
        text = row.to_set or ("" if verbose else row.text)
        first = said.setdefault((row.question, text), row.sensor)
        yield text if first == row.sensor or row.offers or not text else f"As for {first}."
