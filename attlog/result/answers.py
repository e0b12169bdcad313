"""The answers of a document: each tells only what is its own.

An answer leaves out its window and its metric's unit. What it shares with others, such as n, seconds, method, code and
the ids of its units, stands in the list ``evidence``; sentences, units and details stand there by their number in
lists of their own. ``usual`` tells for each window and metric which evidence answers have that tell none: a number, or
the earlier window of the row that gave the answer already. An answer of which nothing else is left is left out; a row
that has none says null. :mod:`attlog.result.restored` is the way back.
"""

from __future__ import annotations

import functools
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from attlog.base.plain import rounded
from attlog.metrics.answer import Answer

ANSWER_DIGITS, EVIDENCE_DIGITS = 6, 5
"""Significant digits of an answer, and of what stands behind it: intervals are wider than a percent."""
OWN = ("value", "ci95", "each", "records", "detail")
"""Fields of an answer that stand in it and not in its evidence; the detail by its number."""
SENTENCES = ("reason", "method")
"""Fields of an answer that are sentences."""
Answers = dict[str, dict[str, Any]]


@functools.cache
def units() -> dict[str, str]:
    """The unit of every metric."""
    from attlog import metrics

    return {name: metric.unit for name, metric in metrics.definitions().items()}


def in_order(metrics: Iterable[str]) -> list[str]:
    """Metrics as they are defined, then those that nobody defines."""
    place = {name: k for k, name in enumerate(units())}
    return sorted(metrics, key=lambda name: place.get(name, len(place)))


def as_written(answer: Answer) -> Answer:
    """An answer with the digits of a document: equal to one that was read back where both were equal."""
    numbers = {"value": answer.value, "ci95": answer.ci95 and list(answer.ci95), "each": list(answer.each)}
    found: dict[str, Any] = _with_digits(numbers)
    units = answer.units
    if units is not None:
        units = replace(units, values=units.values.copy(), on=None)
        units.values[:] = rounded(units.values.tolist(), EVIDENCE_DIGITS)
    return replace(answer, **found | {"ci95": answer.ci95 and tuple(found["ci95"]), "units": units})


def _with_digits(answer: dict[str, Any]) -> dict[str, Any]:
    """The fields of an answer, rounded."""
    behind = ("each", "detail", "units")
    return {k: rounded(v, EVIDENCE_DIGITS if k in behind else ANSWER_DIGITS) for k, v in answer.items()}


def shorten(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shorten the answers of rows in place; the lists that they share, those that are empty left out."""
    shared = Shared()
    for row in rows:
        if "metrics" in row:
            row["metrics"] = shared.short(row["metrics"])
    usual = _usual(row["metrics"] for row in rows if "metrics" in row)
    for row in rows:
        for window, answers in row.get("metrics", {}).items():
            row["metrics"][window] = _unusual(answers, usual[window])
    return ({"usual": usual} if usual else {}) | shared.lists()


class Shared:
    """What answers share, each once, by its JSON text, with its number."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, int]] = {"sentences": {}, "units": {}, "details": {}, "evidence": {}}

    def lists(self) -> dict[str, list[Any]]:
        """The lists of the document; those that are empty are left out."""
        return {name: [json.loads(text) for text in known] for name, known in self._known.items() if known}

    def short(self, metrics: dict[str, Answers]) -> dict[str, Answers]:
        """The answers of a row (window -> metric -> answer), those of an earlier window by its name."""
        seen: dict[str, list[tuple[str, dict[str, Any]]]] = {}
        found: dict[str, Answers] = {}
        for window, answers in metrics.items():
            found[window] = {}
            for metric in in_order(answers):
                usual = {"window": window, "unit": units().get(metric)}
                own = _with_digits({k: v for k, v in answers[metric].items() if k not in usual or usual[k] != v})
                earlier = seen.setdefault(metric, [])
                first = next((place for place, known in earlier if known == own), None)
                if first is None:
                    earlier.append((window, own))
                found[window][metric] = self.taken_from(own) if first is None else {"as_in": first}
        return found

    def taken_from(self, answer: dict[str, Any]) -> dict[str, Any]:
        """The answer with numbers in place of what others may share."""
        own = {key: answer[key] for key in OWN if key in answer}
        rest = {key: value for key, value in answer.items() if key not in OWN}
        if "detail" in own:
            own["detail"] = self._number("details", own["detail"])
        for key in SENTENCES:
            if rest.get(key):
                rest[key] = self._number("sentences", rest[key])
        if found := rest.get("units"):
            own["unit_values"] = found["values"]
            rest["units"] = self._number("units", {key: value for key, value in found.items() if key != "values"})
            if own.get("each") == own["unit_values"]:
                own["each"] = None  # the same numbers
        if answer.get("value") is None:
            rest.pop("ranked", None)  # no answer without a value is ranked
        return own | {"evidence": self._number("evidence", rest)}

    def _number(self, name: str, value: Any) -> int:
        known = self._known[name]
        return known.setdefault(json.dumps(value, ensure_ascii=False, allow_nan=False), len(known))


def _usual(rows: Iterable[dict[str, Answers]]) -> dict[str, dict[str, int | str]]:
    """window -> metric -> the evidence, or the earlier window, that most rows have (the first of equally many)."""
    votes: dict[str, dict[str, Counter[int | str]]] = {}
    for metrics in rows:
        for window, answers in metrics.items():
            of_window = votes.setdefault(window, {})
            for metric, answer in answers.items():
                of_window.setdefault(metric, Counter())[_pointer(answer)] += 1
    return {w: {m: votes[w][m].most_common(1)[0][0] for m in in_order(votes[w])} for w in votes}


def _pointer(answer: dict[str, Any]) -> int | str:
    found: int | str = answer["as_in"] if "as_in" in answer else answer["evidence"]
    return found


def _unusual(answers: Answers, usual: dict[str, int | str]) -> dict[str, Any]:
    """The answers of a window without what is usual; null for a metric that usually has one and here has none."""
    found: dict[str, Any] = {}
    for metric, pointer in usual.items():
        answer = answers.get(metric)
        if answer is not None and _pointer(answer) == pointer:
            answer = {key: value for key, value in answer.items() if key not in ("evidence", "as_in")}
        if answer != {}:
            found[metric] = answer
    return found
