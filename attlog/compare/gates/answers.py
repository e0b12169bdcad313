"""Where a gate finds its numbers: a row's answer in a plain document, and the one it is compared with."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from attlog.compare.gates import text as gate_words
from attlog.metrics import Metric, definitions
from attlog.metrics.answer import Answer
from attlog.plain import Misfit, restored

LOST = ("failed", "diverged")
"""States of a row that no gate lets pass."""
Found = tuple[Answer | None, str]
"""An answer with a value, or why there is none."""


@functools.cache
def _definitions() -> dict[str, Metric]:
    return definitions()


def definition(metric: str) -> Metric:
    """What a metric is. KeyError for one that does not exist."""
    return _definitions()[metric]


def rows_of(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The rows of a result's document."""
    return [row for row in document.get("estimators") or [] if isinstance(row, Mapping)]


def answer(row: Mapping[str, Any], metric: str, windows: Iterable[str]) -> tuple[str, Answer | None]:
    """Window and answer: the first window with a value, else the first that knows the metric; ("", None) without."""
    told = row.get("metrics") or {}
    known = [(w, entry) for w in windows if isinstance(entry := (told.get(w) or {}).get(metric), Mapping)]
    chosen = next(((w, e) for w, e in known if e.get("value") is not None), known[0] if known else None)
    return ("", None) if chosen is None else (chosen[0], _restored(chosen[1]))


def of_onboard(rows: Sequence[Mapping[str, Any]], metric: str, window: str) -> Found:
    """The answer of the attitude that flew."""
    row = next((r for r in rows if r.get("name") == "onboard"), None)
    if row is None:
        return None, "the log has no onboard attitude to compare with"
    if row.get("is_reference"):
        return None, "the onboard attitude is the reference itself, there is nothing to compare it with"
    if row.get("status") in LOST:
        return None, f"nothing can be compared with onboard: {gate_words.lost(row)}"
    return _with_value(row, metric, window, "onboard")


def of_baseline(
    document: Mapping[str, Any] | str, name: str, row: Mapping[str, Any], metric: str, window: str
) -> Found:
    """The answer of the same row in the baseline called ``name``; ``document`` may be the reason why there is none.

    The same row bears the same name; else it is the only one of the same filter, whose settings may be others.
    """
    if isinstance(document, str):
        return None, document
    rows = rows_of(document)
    same = [r for r in rows if r.get("name") == row.get("name")] or [r for r in rows if _filter(r) == _filter(row)]
    if len(same) != 1:
        return None, f"the baseline {name} has {'several rows like' if same else 'no row'} {row.get('name')}"
    return _with_value(same[0], metric, window, f"the baseline {name}")


def _filter(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """What a row is but for its settings: kind, filter, and the IMU that it runs on."""
    own = row.get("estimator") or row.get("name")
    return row.get("kind"), own, str(row.get("name")).partition("/imu")[2]


def _with_value(row: Mapping[str, Any], metric: str, window: str, whose: str) -> Found:
    found = answer(row, metric, (window,))[1]
    if found is not None and found.value is not None:
        return found, ""
    return None, f"no {metric} ({window}) of {whose}{f': {found.reason}' if found is not None else ''}"


def _restored(entry: Mapping[str, Any]) -> Answer | None:
    try:
        return restored(Answer, dict(entry), older=True)
    except Misfit:
        return None
