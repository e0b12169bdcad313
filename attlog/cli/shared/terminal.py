"""What ``analyze`` prints of one log: what happened, what is wrong with the log, four answers, the table of filters.

Lines are laid out here, not by rich: no line ends with blanks, and signs that the output cannot show are replaced
before anything is aligned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

from attlog.cli.shared.filter_table import comparison
from attlog.cli.shared.printing import SENTENCES, TextLine, wrapped
from attlog.present.findings import ShownFinding, findings, nothing_wrong
from attlog.present.numbers import listed
from attlog.present.stand_ins import stand_in
from attlog.present.text import clean, typeset

if TYPE_CHECKING:
    from attlog.result import Result


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
    from attlog.cli.shared.sensor_table import set_line
    from attlog.present.alike import alike
    from attlog.result import offered

    def shown(text: str) -> str:
        return stand_in(text, encoding)

    yield from (TextLine(line.text, "bold") for line in wrapped("", shown(title(result)), width))
    if result.headline:
        yield from wrapped("  ", shown(clean(result.headline)), width)
    found = findings(result)
    if verbose or any(not finding.is_note for finding in found):
        yield from wrong(found, shown, width, verbose)
    name = clean(stand_in(str(result.log.get("name") or "LOG"), "utf-8"))
    yield from (TextLine(shown(line.text)) for line in set_line(offered(result.health), name, width))
    for label, sentence in answers(result, min(width, SENTENCES) - ANSWER, verbose):
        yield from wrapped(f"{label:<{ANSWER}}", shown(sentence), width)
    compared = verbose or window != "all" or any(any(rows.values()) for rows in result.ranked.values())
    table = comparison(result, window, width, shown, verbose) if compared else []
    if table:
        yield TextLine("")
        yield from table
        for sentence in alike(result, equations=verbose):
            yield from wrapped("", shown(typeset(sentence)), width)


def title(result: Result) -> str:
    """Which log it is: the file, what flew with which firmware, how long the log is."""
    from attlog.present.flight import firmware
    from attlog.present.numbers import duration

    log = result.log
    about = [str(log.get("vehicle") or ""), firmware(result).partition(" on ")[0]]
    about += ["simulated" if log.get("simulated") else "", duration(log.get("duration_s"))]
    name = clean(stand_in(str(log.get("name") or "log"), "utf-8"))
    return f"{name}; {clean(', '.join(part for part in about if part))}"


def answers(result: Result, width: int, verbose: bool) -> Iterator[tuple[str, str]]:
    """The answers with their labels: short ones, or whole sentences and what was subtracted from the gyro."""
    from attlog.present.gyro_bias import gyro_bias
    from attlog.present.sentences import QUESTIONS
    from attlog.present.sentences.brief import brief_answers

    if verbose:
        yield from ((QUESTIONS.get(v.question, v.question), typeset(v.sentence)) for v in result.verdicts)
        yield from (("gyro bias", typeset(sentence)) for sentence in gyro_bias(result))
    elif result.verdicts:
        found = {QUESTIONS[q]: typeset(answer.within(width)) for q, answer in brief_answers(result).items()}
        yield from said_once(found)


def said_once(found: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Answers with their labels; a reason why several questions have none stands once, behind their names."""
    from attlog.present.sentences.brief import NO_ANSWER

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
    nothing = nothing_wrong(every, len(found) - len(every))
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
