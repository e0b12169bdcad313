"""The answers of a document, whole again: the way back from :mod:`attlog.result.answers`, also of older documents.

ValueError with the place where something points to what is not there.
"""

from __future__ import annotations

from typing import Any

from attlog.result.answers import SENTENCES, Answers, in_order, units

LISTS = ("sentences", "units", "details", "evidence")


def expanded(found: dict[str, Any]) -> dict[str, Any]:
    """A document with its answers as :func:`attlog.result.answers.shorten` was given them."""
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
