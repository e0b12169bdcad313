"""Words and numbers of a comparison: the table, the sentences and the page write a difference by these alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from attlog.compare.differences.comparison import LogDifference, PooledDifference, Question
from attlog.compare.differences.paired import Direction
from attlog.compare.differences.questions import PLACES
from attlog.metrics import definitions
from attlog.metrics.base import Wording, named
from attlog.present.numbers import MINUS, between, change, change_end, decimals, number, unit_sign

TURNED: dict[Direction, Direction] = {"better": "worse", "worse": "better"}
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
            TURNED.get(self.direction, self.direction),
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


def directed(question: Question, found: LogDifference | PooledDifference) -> DirectedDifference | None:
    """A difference as the second configuration sees it; None where there is none."""
    if found.value is None:
        return None
    if isinstance(found, PooledDifference):
        logs = found.logs, found.better, found.worse
    else:
        even = 1.0 if question.scale == "ratio" else 0.0
        logs = 1, int(found.value < even), int(found.value > even)
    return DirectedDifference(question, found.value, found.ci95, found.direction, *logs, found.floor)


def wording(question: Question) -> Wording:
    """The words of a question: its metric's own, else made of its title; a phase of the flight stands behind them."""
    metric = named(definitions().values(), question.metric)
    words, place = metric.wording, PLACES.get(question.windows[0]) if metric.asked == "phases" else None
    if words is not None:
        return words if place is None else replace(words, more=f"{words.more} {place}", less=f"{words.less} {place}")
    title = subject_of(question)
    if question.better in ("low", "zero"):
        return Wording("has a", f"smaller {title}", f"larger {title}", title)
    return Wording("is", f"nearer to perfect in {title}", f"farther off in {title}", title)


def subject_of(question: Question) -> str:
    """A question after "in": ``tilt error``, ``noise added in hover``."""
    return question.title[:1].lower() + question.title[1:]


def amount(x: float, question: Question) -> str:
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


def value(x: float | None, question: Question) -> str:
    """A configuration's own value in the table, without its unit."""
    if x is not None and question.unit == "deg" and 0.0 < abs(x) < 0.0095:
        return f"{MINUS if x < 0.0 else ''}{abs(x):.2g}"
    if x is None or question.unit != "ms":
        return number(x, question.unit)
    return signed(x, question).removesuffix(" ms")


def signed(x: float, question: Question) -> str:
    """The same with the sign it has: ``−24 %``, ``+3.2 ms``."""
    if question.scale == "ratio":
        return change(x)
    text = amount(x, question)
    return ("" if x == 0.0 or text.startswith("<") else MINUS if x < 0.0 else "+") + text


def scale_title(question: Question, first: str) -> str:
    """What the axis of a plot of differences says."""
    unit = "%" if question.scale == "ratio" else unit_sign(question.unit)
    return f"beside {first}, {unit}" if unit else f"beside {first}"


def span(view: DirectedDifference) -> str:
    """The interval of a difference as it stands in the table: ``−31 to −15 %``; empty without one."""
    if view.ci95 is None:
        return ""
    if view.question.scale == "ratio":
        return between(*map(change_end, view.ci95))
    low, high = (signed(end, view.question) for end in view.ci95)
    return f"{low.removesuffix(unit_sign(view.question.unit)).rstrip()} to {high}"


def favour(view: DirectedDifference) -> str:
    """A significant difference as the better one sees it: ``24 % closer (15 % to 31 %, better on 8 of 9 logs)``."""
    inside = (
        [] if view.ci95 is None else [f"{amount(view.ci95[1], view.question)} to {amount(view.ci95[0], view.question)}"]
    )
    inside += [f"better on {view.better} of {view.logs} logs"] if view.logs > 1 else []
    tail = f" ({', '.join(inside)})" if inside else ""
    size = amount(view.value, view.question)
    return size if size == "not comparable" else f"{size} {wording(view.question).more}{tail}"


def clause(view: DirectedDifference, other: str) -> str:
    """What one does beside the other, without subject and full stop."""
    words, question = wording(view.question), view.question
    if view.direction == "same":
        return f"is equal to {other} in {subject_of(question)}"
    count = ""
    if view.logs > 1:
        sign, n = ("worse", view.worse) if view.direction == "worse" else ("better", view.better)
        count = f"{sign} on {n} of {view.logs} logs"
    if view.direction == "not significant":
        if words.none and view.ci95 and view.ci95[1] <= max(words.none, view.floor):
            return f"{words.verb} no {words.less} than {other} ({_at_most(view, words.none)})"
        inside = ", ".join(p for p in (span(view.turned if view.flipped else view), "" if view.flipped else count) if p)
        tail = f" ({inside})" if inside else ""
        return f"does not differ significantly from {other} in {subject_of(question)}{tail}"
    size = amount(view.value, question)
    if size == "not comparable":
        return f"is {size} with {other} in {subject_of(question)}"
    ends = None if view.ci95 is None else sorted(view.ci95, key=lambda x: _size(x, question))
    reach = "" if ends is None else f"{amount(ends[0], question)} to {amount(ends[1], question)}"
    inside = ", ".join(p for p in (reach, count) if p)
    word = words.more if view.direction == "better" else words.less
    tail = f" ({inside})" if inside else ""
    return f"{words.verb} {size} {word} than {other}{tail}"


def _at_most(view: DirectedDifference, none: float) -> str:
    """How sure it is that there is no difference to speak of: both ends are small, or the one that counts."""
    low, high = view.ci95 or (0.0, 0.0)
    largest = max(abs(low), abs(high))
    small = largest <= max(none, view.floor)
    return f"within {amount(largest, view.question)}" if small else f"at most {amount(high, view.question)}"


def _size(x: float, question: Question) -> float:
    return abs(x - 1.0) if question.scale == "ratio" else abs(x)
