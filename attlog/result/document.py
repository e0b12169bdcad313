"""A result as its JSON document: nothing that a reader knows anyway, and nothing twice.

What has its default is left out. An answer leaves out its window and its metric's unit, and an answer that the row
already gave in an earlier window tells only which (``as_in``). Beside its own value, interval and code an answer has a
number in the list ``evidence``: what it shares with others, such as n, seconds, method, reason and the ids of its
units. Sentences stand there by their number in the list ``sentences``. Answers have ten significant digits.
"""

from __future__ import annotations

import functools
import json
import re
from typing import Any

from attlog.base.plain import plain, rounded, without

SCHEMA_NAME, SCHEMA_NUMBER = "attlog-result/", 5
SCHEMA = f"{SCHEMA_NAME}{SCHEMA_NUMBER}"
MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
"""What differs between two runs of the same log; ``--deterministic`` leaves it out."""
ANSWER_DIGITS = 10
OWN = ("value", "ci95", "code", "each", "records")
"""Fields of an answer that stand in it and not in its evidence."""
SENTENCES = ("reason", "method")
"""Fields of an answer that are sentences."""
NOT_UTF8 = re.compile("[\ud800-\udfff]")
"""Bytes of a file name that are not UTF-8, as Python keeps them: UTF-8 cannot hold them, a JSON escape can."""
KEPT = ("value", "code")
"""What an answer tells beside the earlier window that has the same one."""
Answers = dict[str, dict[str, Any]]


def document(result: Any, deterministic: bool = False) -> dict[str, Any]:
    """The JSON document of a :class:`~attlog.result.Result`; ``deterministic``: without what another run may change."""
    found: dict[str, Any] = {"schema": SCHEMA} | plain(result, defaults=False) | {"schema": SCHEMA}
    if deterministic:
        found = without(found, MEASURED_TIMES) | {"command": ""}
    shared = Shared()
    for row in found.get("estimators", []):
        if "metrics" in row:
            row["metrics"] = _short(row["metrics"], shared)
    return found | shared.lists()


class Shared:
    """What answers share, each once: sentences, and evidence by its JSON text, with their numbers."""

    def __init__(self) -> None:
        self.sentences: dict[str, int] = {}
        self.evidence: dict[str, int] = {}

    def lists(self) -> dict[str, list[Any]]:
        """The lists of the document; those that are empty are left out."""
        evidence = [json.loads(text) for text in self.evidence]
        return {k: v for k, v in (("sentences", list(self.sentences)), ("evidence", evidence)) if v}

    def taken_from(self, answer: dict[str, Any]) -> dict[str, Any]:
        """The answer with a number in place of what others may share."""
        own = {key: answer[key] for key in OWN if key in answer}
        rest = {key: value for key, value in answer.items() if key not in OWN}
        for key in SENTENCES:
            if rest.get(key):
                rest[key] = self.sentences.setdefault(rest[key], len(self.sentences))
        if units := rest.get("units"):
            own["unit_values"] = units["values"]
            rest["units"] = {key: value for key, value in units.items() if key != "values"}
        if answer.get("value") is None:
            rest.pop("ranked", None)  # no answer without a value is ranked
        return own | ({"evidence": self.evidence.setdefault(_text(rest), len(self.evidence))} if rest else {})


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def expanded(found: dict[str, Any]) -> dict[str, Any]:
    """A document with the answers as :func:`document` was given them. ValueError with the place where they are not."""
    lists = {name: found.get(name, []) for name in ("sentences", "evidence")}
    rows = found.get("estimators", [])
    if not all(isinstance(part, list) for part in (rows, *lists.values())):
        return found
    rest = {key: value for key, value in found.items() if key not in lists}
    return rest | {"estimators": [_expanded_row(row, lists, f"estimators[{k}]") for k, row in enumerate(rows)]}


@functools.cache
def units() -> dict[str, str]:
    """The unit of every metric."""
    from attlog import metrics

    return {name: metric.unit for name, metric in metrics.definitions().items()}


def _short(metrics: dict[str, Answers], shared: Shared) -> dict[str, Answers]:
    """The answers of a row (window -> metric -> answer), those that are there already by the window of the first."""
    seen: dict[str, list[tuple[str, dict[str, Any]]]] = {}
    found: dict[str, Answers] = {}
    for window, answers in metrics.items():
        found[window] = {}
        for metric, answer in answers.items():
            usual = {"window": window, "unit": units().get(metric)}
            own = {key: value for key, value in answer.items() if key not in usual or usual[key] != value}
            own = rounded(own, ANSWER_DIGITS)
            earlier = seen.setdefault(metric, [])
            first = next((place for place, known in earlier if known == own), None)
            if first is None:
                earlier.append((window, own))
                found[window][metric] = shared.taken_from(own)
            else:
                found[window][metric] = {key: own[key] for key in KEPT if key in own} | {"as_in": first}
    return found


def _expanded_row(row: Any, lists: dict[str, list[Any]], place: str) -> Any:
    metrics = row.get("metrics") if isinstance(row, dict) else None
    if not isinstance(metrics, dict) or not all(isinstance(answers, dict) for answers in metrics.values()):
        return row  # what is wrong with it is told where types are checked
    whole: dict[str, Answers] = {}
    for window, answers in metrics.items():
        whole[window] = {}
        for metric, answer in answers.items():
            here = f"{place}.metrics.{window}.{metric}"
            if isinstance(answer, dict) and "as_in" in answer:
                first = whole.get(str(answer["as_in"]), {}).get(metric)
                if first is None:
                    raise ValueError(f"{here}.as_in: there is no such answer in {answer['as_in']!r}")
                if other := [key for key, value in answer.items() if key != "as_in" and first.get(key) != value]:
                    raise ValueError(f"{here}.{other[0]}: differs from that in {answer['as_in']!r}")
                whole[window][metric] = first | {"window": window}
            elif isinstance(answer, dict):
                usual = {"unit": units().get(metric, ""), "window": window}
                whole[window][metric] = usual | _whole_answer(answer, lists, here)
            else:
                whole[window][metric] = answer
    return row | {"metrics": whole}


def _whole_answer(answer: dict[str, Any], lists: dict[str, list[Any]], place: str) -> dict[str, Any]:
    """An answer with its evidence and sentences in place of their numbers."""
    own = dict(answer)
    evidence = _at(lists["evidence"], own.get("evidence"), f"{place}.evidence", "evidence")
    if isinstance(evidence, dict):
        del own["evidence"]
        own = evidence | own
    if "unit_values" in own:
        known = own.get("units")
        own["units"] = (known if isinstance(known, dict) else {}) | {"values": own.pop("unit_values")}
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
