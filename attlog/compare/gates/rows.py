"""Which rows does a gate mean, and in which window does it look?"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from attlog.compare.differences.questions import asked
from attlog.result import EstimatorRow

BASELINES = ("gyro", "accel_mag")
"""Estimators that are drawn beside the others and are not meant to be good: they diverge on any long flight."""
WILD = frozenset("*?[")


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
