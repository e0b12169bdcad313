"""The assessments of sensors on a terminal: the table of ``attlog health``, and the line that ``analyze`` adds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from attlog.cli.shared.printing import SENTENCES, TextLine, wrapped
from attlog.present.health import ShownAssessment, change, reasons, said_once, shown_assessments, titles

if TYPE_CHECKING:
    from attlog.result import Assessment, Setting

STYLES = {"fault": "red", "warning": "yellow"}
LABEL = 10
"""Columns of what a line is about, as of the findings and answers of ``analyze``."""
GAP = 2

Shown = Callable[[str], str]
"""A text as the output can show it."""


def sensor_lines(health: Sequence[Assessment], shown: Shown, width: int, verbose: bool) -> Iterator[TextLine]:
    """The table of what is off or may be set, faults first; what is ok and what cannot be told in a line each, with the
    number of sensors where there are several.

    ``verbose``: what is ok as rows, too, the evidence of each, and why the rest cannot be told.
    """
    every = shown_assessments(health)
    ok = [a for a in every if a.verdict == "ok" and not a.listed]
    silent = [a for a in every if a.verdict == "unknown" and not a.listed]
    listed = [a for a in every if a.listed]
    yield from _table(said_once(listed + ok if verbose else listed), shown, width, verbose)
    if ok and not verbose:
        yield from wrapped("  ok: ", shown(titles(ok)), width)
    if silent and not verbose:
        yield from wrapped("  no answer: ", shown(f"{titles(silent)} (why: -v)"), width)
    for questions, why in reasons(silent) if verbose else ():
        yield from wrapped("  no answer: ", shown(questions), width)
        yield from _below([why], shown, width, 6, "dim")
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
    """A row for each: sensor, question, verdict, value; below it what was found and what to set or to do.

    Where long names leave no columns for the value it begins the lines below. ``verbose``: then what else is known.
    """
    if not rows:
        return
    head = ("sensor", "question", "verdict", "value")
    cells = [tuple(shown(text) for text in (a.sensor, a.question, a.verdict, a.value)) for a in rows]
    widths = [max(len(row[i]) for row in (head, *cells)) + GAP for i in range(len(head))]
    beside = len(head) if GAP + sum(widths) - GAP <= width else len(head) - 1
    laid = [(" " * GAP + "".join(map(str.ljust, row[:beside], widths))).rstrip() for row in (head, *cells)]
    yield TextLine(laid[0], "bold")
    for a, line, row in zip(rows, laid[1:], cells, strict=True):
        yield TextLine(line, STYLES.get(a.verdict, ""))
        yield from _below([*row[beside:], a.text, a.to_set], shown, width)
        yield from _below(a.why if verbose else (), shown, width, 6, "dim")


def _below(texts: Sequence[str], shown: Shown, width: int, indent: int = 4, style: str = "") -> Iterator[TextLine]:
    """Texts below a row, each from a line of its own; what is empty is left out."""
    for text in filter(None, texts):
        yield from (TextLine(line.text, style) for line in wrapped(" " * indent, shown(text), width))
