"""Everything that ``analyze`` says about one log on the terminal: sentences, table, what is wrong with the log."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from attlog.cli.shared.layout import Line
from attlog.present.problems import Said, nothing_wrong, problems
from attlog.present.stand_ins import stand_in
from attlog.present.text import clean, typeset

if TYPE_CHECKING:
    from attlog.result import Result

SENTENCES = 100
"""Columns over which sentences are laid out; longer lines are hard to read."""


def printed(result: Result, window: str, width: int, encoding: str, verbose: bool = False) -> Iterator[Line]:
    """The lines for one log, at most ``width`` columns wide where words can be broken.

    ``window``: where the table looks; ``encoding``: of the output, signs that it lacks get
    stand-ins; ``verbose`` shows notes among the problems too.
    """
    from attlog.cli.shared.filter_table import comparison
    from attlog.present.alike import alike
    from attlog.present.gyro_bias import gyro_bias

    def shown(text: str) -> str:
        return stand_in(text, encoding)

    yield Line(shown(clean(stand_in(str(result.log.get("name") or "log"), "utf-8"))), "bold")
    for verdict in result.verdicts:
        yield from wrapped(f"  {verdict.question:<10}", shown(typeset(verdict.sentence)), width)
    for sentence in gyro_bias(result):
        yield from wrapped(f"  {'gyro bias':<10}", shown(typeset(sentence)), width)
    yield Line("")
    yield from wrong(problems(result), shown, width, verbose)
    table = comparison(result, window, width, shown)
    if table:
        yield Line("")
        yield from table
    for sentence in alike(result) if table else []:
        yield from wrapped("", shown(typeset(sentence)), width)


def wrong(found: list[Said], shown: Callable[[str], str], width: int, verbose: bool) -> Iterator[Line]:
    """What is wrong with the log, the worst first, each with cause, remedy and meaning; notes only if ``verbose``."""
    listed = [p for p in found if verbose or p.style != "note"]
    yield Line(shown("What is wrong with this log"), "bold")
    nothing = nothing_wrong(listed, len(found) - len(listed))
    if nothing:
        yield Line(f"  {nothing}")
    for problem in listed:
        where = f" ({problem.where})" if problem.where else ""
        times = f" ({problem.count} times)" if problem.count > 1 and f" {problem.count} " not in problem.text else ""
        yield from wrapped(f"  {problem.label.lower()}: ", shown(f"{typeset(problem.text)}{where}{times}"), width)
        for label, text in problem.more:
            yield from wrapped(f"      {label:<4} ", shown(typeset(text)), width)


def wrapped(label: str, text: str, width: int) -> Iterator[Line]:
    """A sentence after its label, broken between words."""
    lines = textwrap.wrap(text, min(width, SENTENCES) - len(label), break_long_words=False, break_on_hyphens=False)
    for i, line in enumerate(lines or [""]):
        yield Line(((label if i == 0 else " " * len(label)) + line).rstrip())
