"""Changes by their meaning: question by question, the numbers of the report first, worse before better."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING

from attlog.compare.differences.questions import MAIN

if TYPE_CHECKING:
    from attlog.compare.diff.changes import NumberChange

ROOMS = {"errors": "Accuracy", "noise": "Noise", "steps": "Step response", "drift": "Yaw drift"}
"""Rooms of metrics and what their question is called."""
OTHER = "Other numbers"
ORDER = (*ROOMS.values(), OTHER)
VERDICTS = ("beyond", "vanished", "appeared", "not_significant", "within")


@cache
def titles() -> dict[str, tuple[str, str]]:
    """Metric id -> its question and its title."""
    from attlog.metrics import QUESTIONS, questions

    pairs = zip(QUESTIONS, questions(), strict=True)
    return {m.name: (ROOMS.get(name.partition(".")[0], OTHER), m.title) for name, q in pairs for m in q.METRICS}


def question_of(metric: str) -> str:
    """The question that a metric answers; an air drift's id ends with its heading reference."""
    return _found(metric)[0]


def title_of(metric: str) -> str:
    """What a metric is called, its id where nobody knows it."""
    return _found(metric)[1]


def _found(metric: str) -> tuple[str, str]:
    known = titles()
    return known.get(metric) or known.get(metric.rpartition(".")[0], (OTHER, metric))


def is_main(m: NumberChange) -> bool:
    """Whether a comparison asks for this number in this window."""
    known = titles()
    metric = m.metric if m.metric in known else m.metric.rpartition(".")[0]
    return any(metric == name and m.window == windows[0] for name, windows in MAIN)


def sorted_changes(moved: Iterable[NumberChange]) -> list[NumberChange]:
    """What is beyond its tolerance first, by question, there the numbers that a comparison asks for.

    Worse stands before better, the most tolerances before fewer.
    """
    return sorted(moved, key=_key)


def _key(m: NumberChange) -> tuple[bool, int, bool, int, float, int]:
    side = 0 if m.closer is False else 1 if m.verdict in ("vanished", "appeared") else 3 if m.closer else 2
    quiet = m.verdict in ("not_significant", "within")
    return quiet, ORDER.index(question_of(m.metric)), not is_main(m), side, -times(m), VERDICTS.index(m.verdict)


def times(m: NumberChange) -> float:
    """A difference in tolerances."""
    if m.difference is None or m.tolerance is None:
        return 0.0
    return abs(m.difference) / m.tolerance if m.tolerance > 0.0 else math.inf
