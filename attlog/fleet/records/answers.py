"""Every number of a result in little space, filters' and sensors': for tables over many logs."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass
from typing import Any

from attlog.result import MEASURED_TIMES, Answer, Assessment, Result

SENSORS = "sensors"
"""The window of what assessments say of sensors: each question knows its own seconds. The row is the sensor."""


@dataclass(frozen=True, slots=True)
class Number:
    """One metric of one row in one window: a value with interval, or the code and reason why there is none."""

    row: str
    window: str
    metric: str
    unit: str
    value: float | None
    low: float | None
    high: float | None
    n: int | None
    seconds: float | None
    code: str | None
    reason: str | None


def packed(result: Result) -> dict[str, Any]:
    """All answers as plain values, without measured times; assessments stand as metrics of their sensor.

    ``values``: row -> window -> metric -> [value, low, high, n, seconds], or the place in ``missing`` of
    [code, reason]; ``units``: metric -> unit. A sentence that many answers share stands there once.
    """
    missing: dict[tuple[str, str], int] = {}
    units: dict[str, str] = {}
    values: dict[str, dict[str, dict[str, Any]]] = {}
    for row in result.estimators:
        for window, answers in row.metrics.items():
            kept = {m: a for m, a in answers.items() if m not in MEASURED_TIMES}
            units |= {m: a.unit for m, a in kept.items()}
            if kept:
                place = values.setdefault(row.name, {}).setdefault(window, {})
                place |= {m: _packed(a, missing) for m, a in kept.items()}
    for found in result.health:
        units[found.question] = found.unit or units.get(found.question, "")
        place = values.setdefault(found.sensor or SENSORS, {}).setdefault(SENSORS, {})
        place[found.question] = _of_sensor(found, missing)
    return {"values": values, "missing": [list(k) for k in missing], "units": units}


def _packed(answer: Answer, missing: dict[tuple[str, str], int]) -> Any:
    if answer.value is None:
        return missing.setdefault((answer.code or "", answer.reason or ""), len(missing))
    low, high = answer.ci95 or (None, None)
    return [answer.value, low, high, answer.n, answer.seconds]


def _of_sensor(found: Assessment, missing: dict[tuple[str, str], int]) -> Any:
    """An assessment as an answer; one without a value tells its verdict in place of a code."""
    if found.value is None:
        return missing.setdefault((found.verdict, found.text), len(missing))
    low, high = found.ci95 or (None, None)
    return [found.value, low, high, found.n, found.seconds]


def numbers(answers: dict[str, Any], wanted: Container[str] | None = None) -> Iterator[Number]:
    """What :func:`packed` made, one by one; of the ``wanted`` metrics alone where they are given."""
    units, missing = answers["units"], answers["missing"]
    for row, windows in answers["values"].items():
        for window, metrics in windows.items():
            for metric, found in metrics.items():
                if wanted is not None and metric not in wanted:
                    continue
                if isinstance(found, int):
                    code, reason = missing[found]
                    yield Number(row, window, metric, units[metric], None, None, None, None, None, code, reason)
                else:
                    value, low, high, n, seconds = found
                    yield Number(row, window, metric, units[metric], value, low, high, n, seconds, None, None)
