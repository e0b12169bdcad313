"""A result as its JSON document: nothing that a reader knows anyway, and nothing twice.

What has its default is left out. An answer leaves out its window and its metric's unit, an answer that the row already
gave in an earlier window tells only which (``as_in``), and the sentences of answers (``reason``, ``method``) stand in
one list, ``sentences``, each once: an answer has their numbers there.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from typing import Any

from attlog.base.plain import plain, without

SCHEMA_NAME, SCHEMA_NUMBER = "attlog-result/", 5
SCHEMA = f"{SCHEMA_NAME}{SCHEMA_NUMBER}"
MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
"""What differs between two runs of the same log; ``--deterministic`` leaves it out."""
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
    sentences: dict[str, int] = {}
    for row in found.get("estimators", []):
        if "metrics" in row:
            row["metrics"] = _short(row["metrics"], sentences)
    return found | {"sentences": list(sentences)} if sentences else found


def expanded(found: dict[str, Any]) -> dict[str, Any]:
    """A document with the answers as :func:`document` was given them. ValueError with the place where they are not."""
    sentences, rows = found.get("sentences", []), found.get("estimators", [])
    rest = {key: value for key, value in found.items() if key != "sentences"}
    if not isinstance(rows, list) or not isinstance(sentences, list):
        return found
    return rest | {"estimators": [_expanded_row(row, sentences, f"estimators[{k}]") for k, row in enumerate(rows)]}


@functools.cache
def units() -> dict[str, str]:
    """The unit of every metric."""
    from attlog import metrics

    return {name: metric.unit for name, metric in metrics.definitions().items()}


def _short(metrics: dict[str, Answers], sentences: dict[str, int]) -> dict[str, Answers]:
    """The answers of a row (window -> metric -> answer), those that are there already by the window of the first."""
    seen: dict[str, list[tuple[str, dict[str, Any]]]] = {}
    found: dict[str, Answers] = {}
    for window, answers in metrics.items():
        found[window] = {}
        for metric, answer in answers.items():
            usual = {"window": window, "unit": units().get(metric)}
            own = {key: value for key, value in answer.items() if key not in usual or usual[key] != value}
            earlier = seen.setdefault(metric, [])
            first = next((place for place, known in earlier if known == own), None)
            if first is None:
                earlier.append((window, own))
                numbers = {k: sentences.setdefault(own[k], len(sentences)) for k in SENTENCES if own.get(k)}
                found[window][metric] = own | numbers
            else:
                found[window][metric] = {key: own[key] for key in KEPT if key in own} | {"as_in": first}
    return found


def _expanded_row(row: Any, sentences: list[Any], place: str) -> Any:
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
                said = dict(_said(answer, sentences, here))
                whole[window][metric] = {"unit": units().get(metric, ""), "window": window} | answer | said
            else:
                whole[window][metric] = answer
    return row | {"metrics": whole}


def _said(answer: dict[str, Any], sentences: list[Any], place: str) -> Iterator[tuple[str, Any]]:
    """The sentences of an answer in place of their numbers."""
    for key in SENTENCES:
        number = answer.get(key)
        if isinstance(number, bool) or not isinstance(number, int):
            continue
        if not 0 <= number < len(sentences):
            raise ValueError(f"{place}.{key}: there is no sentence {number}")
        yield key, sentences[number]
