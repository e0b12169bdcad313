"""The answers of a document: each tells only what is its own.

An answer leaves out its window and its metric's unit. What it shares with others, such as n, seconds, method, code and
the ids of its units, stands in the list ``evidence``; sentences, units and details stand there by their number in
lists of their own. ``usual`` tells for each window and metric which evidence answers have that tell none: a number, or
the earlier window of the row that gave the answer already. An answer of which nothing else is left is left out; a row
that has none says null. :mod:`attlog.result.document` is the way back.
"""

from __future__ import annotations

import functools
import json
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from attlog.core.plain import rounded_document, to_plain, without_keys
from attlog.metrics.metric import Answer

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
        units.values[:] = rounded_document(units.values.tolist(), EVIDENCE_DIGITS)
    return replace(answer, **found | {"ci95": answer.ci95 and tuple(found["ci95"]), "units": units})


def _with_digits(answer: dict[str, Any]) -> dict[str, Any]:
    """The fields of an answer, rounded."""
    behind = ("each", "detail", "units")
    return {k: rounded_document(v, EVIDENCE_DIGITS if k in behind else ANSWER_DIGITS) for k, v in answer.items()}


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


# The answers of a document, whole again: the way back from :mod:`attlog.result.document`, also of older documents.
#
# ValueError with the place where something points to what is not there.

LISTS = ("sentences", "units", "details", "evidence")


def expanded(found: dict[str, Any]) -> dict[str, Any]:
    """A document with its answers as :func:`attlog.result.document.shorten` was given them."""
    lists = {name: found.get(name, []) for name in LISTS}
    rows, usual = found.get("estimators", []), found.get("usual", {})
    sound = isinstance(usual, dict) and all(isinstance(of_window, dict) for of_window in usual.values())
    if not (sound and all(isinstance(part, list) for part in (rows, *lists.values()))):
        return found
    rest = {key: value for key, value in found.items() if key not in (*LISTS, "usual")}
    return rest | {"estimators": [_row(row, usual, lists, f"estimators[{k}]") for k, row in enumerate(rows)]}


def _row(row: Any, usual: dict[str, dict[str, Any]], lists: dict[str, list[Any]], place: str) -> Any:
    metrics = row.get("metrics") if isinstance(row, dict) else None
    if not isinstance(metrics, dict) or not all(isinstance(answers, dict) for answers in metrics.values()):
        return row  # what is wrong with it is told where types are checked
    whole: dict[str, Answers] = {}
    for window, answers in metrics.items():
        whole[window] = {}
        pointers = usual.get(window, {})
        for metric in in_order(pointers | answers):
            answer, pointer = answers.get(metric, {}), pointers.get(metric)
            if answer is None and metric in pointers:
                continue
            if isinstance(answer, dict):
                if not {"evidence", "as_in"} & answer.keys() and metric in pointers:
                    answer = answer | {"as_in" if isinstance(pointer, str) else "evidence": pointer}
                answer = _answer(answer, whole, metric, window, lists, f"{place}.metrics.{window}.{metric}")
            whole[window][metric] = answer
    return row | {"metrics": whole}


def _answer(
    answer: dict[str, Any],
    earlier: dict[str, Answers],
    metric: str,
    window: str,
    lists: dict[str, list[Any]],
    place: str,
) -> dict[str, Any]:
    if "as_in" not in answer:
        return {"unit": units().get(metric, ""), "window": window} | _whole(answer, lists, place)
    first = earlier.get(str(answer["as_in"]), {}).get(metric)
    if first is None:
        raise ValueError(f"{place}.as_in: there is no such answer in {answer['as_in']!r}")
    if other := [key for key, value in answer.items() if key != "as_in" and first.get(key) != value]:
        raise ValueError(f"{place}.{other[0]}: differs from that in {answer['as_in']!r}")
    return first | {"window": window}


def _whole(answer: dict[str, Any], lists: dict[str, list[Any]], place: str) -> dict[str, Any]:
    """An answer with evidence, detail, units and sentences in place of their numbers."""
    own = dict(answer)
    evidence = _at(lists["evidence"], own.get("evidence"), f"{place}.evidence", "evidence")
    if isinstance(evidence, dict):
        del own["evidence"]
        own = evidence | own
    for key, name, what in (("detail", "details", "detail"), ("units", "units", "entry of units")):
        shared = _at(lists[name], own.get(key), f"{place}.{key}", what)
        if shared is not None:
            own[key] = shared
    if "unit_values" in own:
        known, values = own.get("units"), own.pop("unit_values")
        own["units"] = (known if isinstance(known, dict) else {}) | {"values": values}
        if "each" in own and own["each"] is None:
            own["each"] = values
    for key in SENTENCES:
        sentence = _at(lists["sentences"], own.get(key), f"{place}.{key}", "sentence")
        if sentence is not None:
            own[key] = sentence
    return own


def _at(known: list[Any], number: Any, place: str, what: str) -> Any:
    """What stands at a number; None for what is none. ValueError with the place where the list has no such number."""
    if isinstance(number, bool) or not isinstance(number, int):
        return None
    if not 0 <= number < len(known):
        raise ValueError(f"{place}: there is no {what} {number}")
    return known[number]


# A result as its JSON document: nothing that a reader knows anyway, and nothing twice.
#
# What has its default is left out. :mod:`attlog.result.document` tells how answers are written, which are most of it.

SCHEMA_NAME, SCHEMA_NUMBER = "attlog-result/", 6
SCHEMA = f"{SCHEMA_NAME}{SCHEMA_NUMBER}"
MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
"""What differs between two runs of the same log; ``--deterministic`` leaves it out."""
NOT_UTF8 = re.compile("[\ud800-\udfff]")
"""Bytes of a file name that are not UTF-8, as Python keeps them: UTF-8 cannot hold them, a JSON escape can."""


def document(result: Any, deterministic: bool = False) -> dict[str, Any]:
    """The JSON document of a :class:`~attlog.result.Result`; ``deterministic``: without what another run may change."""
    found: dict[str, Any] = {"schema": SCHEMA} | to_plain(result, defaults=False) | {"schema": SCHEMA}
    if deterministic:
        found = without_keys(found, MEASURED_TIMES) | {"command": ""}
    return found | shorten(found.get("estimators", []))
