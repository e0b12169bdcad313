"""Words and numbers of a comparison: the table, the sentences and the page write a difference by these alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from attlog.compare.comparison import (
    PHASE_PLACES,
    Comparison,
    ConfigurationSentences,
    LogDifference,
    PooledDifference,
    Question,
)
from attlog.compare.paired import Direction
from attlog.metrics import definitions
from attlog.metrics.metric import Wording, named
from attlog.words.names import AGREEMENT
from attlog.words.numbers import MINUS, between, change, change_end, counted, decimals, listed, number, unit_sign
from attlog.words.ranking import SELF_COMPARED

OPPOSITE: dict[Direction, Direction] = {"better": "worse", "worse": "better"}
"""The direction of a difference as the other one sees it, where that is another."""


@dataclass(frozen=True, slots=True)
class DirectedDifference:
    """A difference as one of the two sees it: a ratio below one or a difference below zero is in its favour.

    ``better`` and ``worse`` count the ``logs`` by sign. ``flipped``: it is the first that looks, while
    the table shows the second's view.
    """

    question: Question
    value: float
    ci95: tuple[float, float] | None
    direction: Direction
    logs: int
    better: int
    worse: int
    floor: float
    flipped: bool = False

    @property
    def turned(self) -> DirectedDifference:
        """The same as the other one sees it."""
        ci95 = None if self.ci95 is None else (self._back(self.ci95[1]), self._back(self.ci95[0]))
        return DirectedDifference(
            self.question,
            self._back(self.value),
            ci95,
            OPPOSITE.get(self.direction, self.direction),
            self.logs,
            self.worse,
            self.better,
            self.floor,
            not self.flipped,
        )

    def _back(self, x: float) -> float:
        if self.question.scale == "ratio":
            return 1.0 / x if x else math.inf
        return -x if x else 0.0


def direct_difference(question: Question, found: LogDifference | PooledDifference) -> DirectedDifference | None:
    """A difference as the second configuration sees it; None where there is none."""
    if found.value is None:
        return None
    if isinstance(found, PooledDifference):
        logs = found.logs, found.better, found.worse
    else:
        even = 1.0 if question.scale == "ratio" else 0.0
        logs = 1, int(found.value < even), int(found.value > even)
    return DirectedDifference(question, found.value, found.ci95, found.direction, *logs, found.floor)


def question_wording(question: Question) -> Wording:
    """The words of a question: its metric's own, else made of its title; a phase of the flight stands behind them."""
    metric = named(definitions().values(), question.metric)
    words, place = metric.wording, PHASE_PLACES.get(question.windows[0]) if metric.asked == "phases" else None
    if words is not None:
        return words if place is None else replace(words, more=f"{words.more} {place}", less=f"{words.less} {place}")
    title = subject_of(question)
    if question.better in ("low", "zero"):
        return Wording("has a", f"smaller {title}", f"larger {title}", title)
    return Wording("is", f"nearer to perfect in {title}", f"farther off in {title}", title)


def subject_of(question: Question) -> str:
    """A question after "in": ``tilt error``, ``noise added in hover``."""
    return question.title[:1].lower() + question.title[1:]


def amount_text(x: float, question: Question) -> str:
    """A size with its unit: the change of a ratio, or a difference. Never a sign, never a zero that is none."""
    if question.scale == "ratio":
        return change(x, signed=False)
    size, unit = abs(x), question.unit
    places = (2 if size < 0.995 else 1 if size < 9.95 else 0) if unit == "ms" else decimals(size, unit)
    text = f"{size:.{places}f}"
    if float(text) == 0.0 and size > 0.0:
        text = f"<{10.0**-places:.{places}f}"
    sign = unit_sign(unit)
    return text + sign if sign.startswith("°") else f"{text} {sign}".rstrip()


def own_value_text(x: float | None, question: Question) -> str:
    """A configuration's own value in the table, without its unit."""
    if x is not None and question.unit == "deg" and 0.0 < abs(x) < 0.0095:
        return f"{MINUS if x < 0.0 else ''}{abs(x):.2g}"
    if x is None or question.unit != "ms":
        return number(x, question.unit)
    return signed_text(x, question).removesuffix(" ms")


def signed_text(x: float, question: Question) -> str:
    """The same with the sign it has: ``−24 %``, ``+3.2 ms``."""
    if question.scale == "ratio":
        return change(x)
    text = amount_text(x, question)
    return ("" if x == 0.0 or text.startswith("<") else MINUS if x < 0.0 else "+") + text


def scale_title(question: Question, first: str) -> str:
    """What the axis of a plot of differences says."""
    unit = "%" if question.scale == "ratio" else unit_sign(question.unit)
    return f"beside {first}, {unit}" if unit else f"beside {first}"


def interval_text(view: DirectedDifference) -> str:
    """The interval of a difference as it stands in the table: ``−31 to −15 %``; empty without one."""
    if view.ci95 is None:
        return ""
    if view.question.scale == "ratio":
        return between(*map(change_end, view.ci95))
    low, high = (signed_text(end, view.question) for end in view.ci95)
    return f"{low.removesuffix(unit_sign(view.question.unit)).rstrip()} to {high}"


def favour_text(view: DirectedDifference) -> str:
    """A significant difference as the better one sees it: ``24 % closer (15 % to 31 %, better on 8 of 9 logs)``."""
    inside = (
        []
        if view.ci95 is None
        else [f"{amount_text(view.ci95[1], view.question)} to {amount_text(view.ci95[0], view.question)}"]
    )
    inside += [f"better on {view.better} of {view.logs} logs"] if view.logs > 1 else []
    tail = f" ({', '.join(inside)})" if inside else ""
    size = amount_text(view.value, view.question)
    return size if size == "not comparable" else f"{size} {question_wording(view.question).more}{tail}"


def difference_clause(view: DirectedDifference, other: str) -> str:
    """What one does beside the other, without subject and full stop."""
    words, question = question_wording(view.question), view.question
    if view.direction == "same":
        return f"is equal to {other} in {subject_of(question)}"
    count = ""
    if view.logs > 1:
        sign, n = ("worse", view.worse) if view.direction == "worse" else ("better", view.better)
        count = f"{sign} on {n} of {view.logs} logs"
    if view.direction == "not significant":
        if words.none and view.ci95 and view.ci95[1] <= max(words.none, view.floor):
            return f"{words.verb} no {words.less} than {other} ({_at_most(view, words.none)})"
        inside = ", ".join(
            p for p in (interval_text(view.turned if view.flipped else view), "" if view.flipped else count) if p
        )
        tail = f" ({inside})" if inside else ""
        return f"does not differ significantly from {other} in {subject_of(question)}{tail}"
    size = amount_text(view.value, question)
    if size == "not comparable":
        return f"is {size} with {other} in {subject_of(question)}"
    ends = None if view.ci95 is None else sorted(view.ci95, key=lambda x: _size(x, question))
    reach = "" if ends is None else f"{amount_text(ends[0], question)} to {amount_text(ends[1], question)}"
    inside = ", ".join(p for p in (reach, count) if p)
    word = words.more if view.direction == "better" else words.less
    tail = f" ({inside})" if inside else ""
    return f"{words.verb} {size} {word} than {other}{tail}"


def _at_most(view: DirectedDifference, none: float) -> str:
    """How sure it is that there is no difference to speak of: both ends are small, or the one that counts."""
    low, high = view.ci95 or (0.0, 0.0)
    largest = max(abs(low), abs(high))
    small = largest <= max(none, view.floor)
    return f"within {amount_text(largest, view.question)}" if small else f"at most {amount_text(high, view.question)}"


def _size(x: float, question: Question) -> float:
    return abs(x - 1.0) if question.scale == "ratio" else abs(x)


# What a comparison says: one lead sentence for each configuration beside the first, then one for each question that
# differs significantly. What does not stands in the table alone.
#
# Every number of a sentence stands in the table, written by the same functions
# (:mod:`attlog.compare.wording`). A lead has the changes of the table, a further sentence is about who is
# better.

MAX_NAMED_QUESTIONS = 4
"""So many questions are named in a lead; the table has all."""
STATUS_WORDS = {
    "diverged": "diverged",
    "not_converged": "did not settle",
    "failed": "failed",
    "not_judged": "cannot be judged",
}
"""What a row's state is called after its name."""


def comparison_sentences(found: Comparison) -> list[ConfigurationSentences]:
    """The sentences of a comparison, one entry for each configuration after the first."""
    return [_configuration_sentences(found, c.name) for c in found.configurations[1:]]


def _configuration_sentences(found: Comparison, name: str) -> ConfigurationSentences:
    called = {c.name: c.label for c in found.configurations}
    first = found.configurations[0].name
    a, b, lost = called[first], called[name], _dropped_sentences(found, name)
    views = [
        view
        for q in found.questions
        for c in q.contrasts
        if q.main
        and c.configuration == name
        and c.over is not None
        and (view := direct_difference(q, c.over)) is not None
    ]
    if not views:
        return ConfigurationSentences(
            name, f"{b} and {a} cannot be compared: {_reason_unavailable(found, name)}.", lost
        )
    if all(view.direction == "same" for view in views):
        logs = counted(max(view.logs for view in views), "log")
        return ConfigurationSentences(
            name, f"No difference: {b} and {a} give the same in every question, on {logs}.", lost
        )
    significant = [view for view in views if view.direction in ("better", "worse")]
    if not significant:
        logs = counted(max(view.logs for view in views), "log")
        asked = counted(len(views), "question")
        return ConfigurationSentences(name, f"No significant difference of {b} and {a} in {asked} on {logs}.", lost)
    sides = {d: _change_list([v for v in significant if v.direction == d]) for d in (v.direction for v in significant)}
    lead = ", ".join(f"{direction} in {changes}" for direction, changes in sides.items())
    lead = lead.replace(" in ", f" than {a} in ", 1)
    return ConfigurationSentences(
        name, f"{b} is significantly {lead}.", [*(_question_sentence(view, a, b) for view in significant), *lost]
    )


def _change_list(views: list[DirectedDifference]) -> str:
    """Questions with their changes: ``tilt error (−24 %), lag (−3.2 ms)``."""
    named = [f"{subject_of(v.question)} ({signed_text(v.value, v.question)})" for v in views[:MAX_NAMED_QUESTIONS]]
    rest = len(views) - MAX_NAMED_QUESTIONS
    return listed([*named, f"{rest} more"] if rest > 0 else named)


def _question_sentence(view: DirectedDifference, first: str, second: str) -> str:
    """One question on its own, about the better one if it is significantly so; numbers as the table shows them."""
    if view.direction == "worse":
        return f"{first} {difference_clause(view.turned, second)}."
    return f"{second} {difference_clause(view, first)}."


def _reason_unavailable(found: Comparison, name: str) -> str:
    """Why no question has a difference: the commonest reason."""
    questions = [c for q in found.questions if q.main for c in q.contrasts if c.configuration == name]
    reasons = [b.reason for c in questions for b in c.logs if b.reason]
    reasons = reasons or [line.reason for line in found.logs if line.reason]
    return (
        max(set(reasons), key=lambda r: (reasons.count(r), r)).rstrip(".") if reasons else "no question has an answer"
    )


def _dropped_sentences(found: Comparison, name: str) -> list[str]:
    """Where one of the two drops out: what is left would flatter it; and where there is no truth to compare with."""
    called = {c.name: c.label for c in found.configurations}
    said = []
    for one in (found.configurations[0].name, name):
        lost: dict[tuple[str, str], list[str]] = {}
        for log, cells in found.questions[0].cells.items() if found.questions else ():
            if one in cells and cells[one].status != "ok":
                why = cells[one].reason if cells[one].status == "failed" else ""
                lost.setdefault((cells[one].status, why), []).append(log)
        for (status, why), logs in lost.items():
            where = f"on {listed(logs)}{f' ({why})' if why else ''}"
            said.append(f"{called[one]} {STATUS_WORDS.get(status, status)} {where} and is not compared there.")
    used = [line for line in found.logs if not line.code]
    onboard = sum(line.reference.startswith("onboard") for line in used)
    against = [q for q in found.questions if not q.metric.startswith(SELF_COMPARED)]
    if onboard and any(b.value is not None for q in against for c in q.contrasts for b in c.logs):
        where = "" if onboard == len(used) else f" on {onboard} of {counted(len(used), 'log')}"
        said.append(f"Errors are differences from {AGREEMENT}{where}.")
    return said
