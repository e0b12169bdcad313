"""Which rows does a gate mean, in which window does it look, and which numbers does it compare?"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from attlog.compare.differences.questions import asked
from attlog.compare.gates import text as gate_words
from attlog.metrics import Metric, definitions
from attlog.metrics.answer import Answer
from attlog.result import EstimatorRow, Result

BASELINES = ("gyro", "accel_mag")
"""Estimators that are drawn beside the others and are not meant to be good: they diverge on any long flight."""
WILD = frozenset("*?[")
LOST = ("failed", "diverged")
"""States of a row that no gate lets pass."""
Found = tuple[Answer | None, str]
"""An answer with a value, or why there is none."""


def selected(rows: Sequence[EstimatorRow], filters: Iterable[str] | None) -> tuple[list[EstimatorRow], list[str]]:
    """The rows that patterns name, each once, in the order of the table; and the patterns that name none.

    A pattern means a row's whole name or what stands before ``/imuN`` in it. Onboard attitudes, baselines and the
    reference are meant by name only: a pattern that begins with a wildcard leaves them out. Without patterns every
    estimator row but those.
    """
    if filters is None:
        return [row for row in rows if not _by_name_only(row)], []
    wanted = list(filters)
    names = {id(row): [p for p in wanted if _fits(row, p)] for row in rows}
    found = [row for row in rows if names[id(row)]]
    return found, [p for p in wanted if not any(p in fitting for fitting in names.values())]


def windows(metric: str, window: str | None) -> tuple[str, ...]:
    """Where to look for a metric: in the window named, else in its own ones, of which the first with a value counts."""
    return (window,) if window is not None else asked((metric,))[0].windows


def _by_name_only(row: EstimatorRow) -> bool:
    return row.kind != "replay" or row.estimator in BASELINES or row.is_reference


def _fits(row: EstimatorRow, pattern: str) -> bool:
    if _by_name_only(row) and pattern[:1] in WILD:
        return False
    return fnmatchcase(row.name, pattern) or fnmatchcase(row.name.partition("/imu")[0], pattern)


@functools.cache
def _definitions() -> dict[str, Metric]:
    return definitions()


def definition(metric: str) -> Metric:
    """What a metric is. KeyError for one that does not exist."""
    return _definitions()[metric]


def answer(row: EstimatorRow, metric: str, windows: Iterable[str]) -> tuple[str, Answer | None]:
    """Window and answer: the first window with a value, else the first that knows the metric; ("", None) without."""
    known = [(w, found) for w in windows if (found := row.metrics.get(w, {}).get(metric)) is not None]
    return next(((w, a) for w, a in known if a.value is not None), known[0] if known else ("", None))


def of_onboard(rows: Sequence[EstimatorRow], metric: str, window: str) -> Found:
    """The answer of the onboard attitude."""
    row = next((r for r in rows if r.name == "onboard"), None)
    if row is None:
        return None, "the log has no onboard attitude to compare with"
    if row.is_reference:
        return None, "the onboard attitude is the reference itself, there is nothing to compare it with"
    if row.status in LOST:
        return None, f"nothing can be compared with onboard: {gate_words.lost(row)}"
    return _with_value(row, metric, window, "onboard")


def of_baseline(baseline: Result | str, name: str, row: EstimatorRow, metric: str, window: str) -> Found:
    """The answer of the same row in the baseline called ``name``; ``baseline`` may be the reason why there is none.

    The same row bears the same name; else it is the only one of the same filter, whose settings may be others.
    """
    if isinstance(baseline, str):
        return None, baseline
    rows = baseline.estimators
    same = [r for r in rows if r.name == row.name] or [r for r in rows if _filter(r) == _filter(row)]
    if len(same) != 1:
        return None, f"the baseline {name} has {'several rows like' if same else 'no row'} {row.name}"
    return _with_value(same[0], metric, window, f"the baseline {name}")


def _filter(row: EstimatorRow) -> tuple[str, str, str]:
    """What a row is but for its settings: kind, filter, and the IMU that it runs on."""
    return row.kind, row.estimator or row.name, row.name.partition("/imu")[2]


def _with_value(row: EstimatorRow, metric: str, window: str, whose: str) -> Found:
    found = answer(row, metric, (window,))[1]
    if found is not None and found.value is not None:
        return found, ""
    return None, f"no {metric} ({window}) of {whose}{f': {found.reason}' if found is not None else ''}"
