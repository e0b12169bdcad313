"""Convert a result to its JSON document and back.

Left out are fields with their default, and the window and the unit of an answer (given by its place and its metric).
Answers have six significant digits, their evidence five.
"""

from __future__ import annotations

import functools
import json
import re
from dataclasses import replace
from typing import Any, TypeVar

from attlog.core.errors import UsageError
from attlog.core.plain import rounded_document, to_plain, without_keys
from attlog.metrics.metric import Answer

T = TypeVar("T")
SCHEMA_NAME, SCHEMA_NUMBER = "attlog-result/", 7
SCHEMA = f"{SCHEMA_NAME}{SCHEMA_NUMBER}"
# Fields that differ between two runs of the same log. ``--deterministic`` leaves them out.
MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
# Non-UTF-8 bytes of a file name, as Python's surrogates: UTF-8 cannot encode them, a JSON escape can.
NOT_UTF8 = re.compile("[\ud800-\udfff]")
# Intervals are wider than a percent.
ANSWER_DIGITS, EVIDENCE_DIGITS = 6, 5
EVIDENCE = ("each", "units")
# Number of validation errors printed for a document.
MAX_ERRORS = 3


def document(result: Any, deterministic: bool = False) -> dict[str, Any]:
    """Return the JSON document of a :class:`~attlog.result.Result`.

    ``deterministic``: without measured times.
    """
    found: dict[str, Any] = {"schema": SCHEMA} | to_plain(result, defaults=False) | {"schema": SCHEMA}
    if deterministic:
        found = without_keys(found, MEASURED_TIMES) | {"command": ""}
    for row in found.get("estimators", []):
        for window, answers in row.get("metrics", {}).items():
            for metric, answer in answers.items():
                answers[metric] = _written(answer, metric, window)
    return found


def _written(answer: dict[str, Any], metric: str, window: str) -> dict[str, Any]:
    """Return an answer without fields given by its place."""
    given: dict[str, Any] = {"window": window, "unit": metric_units().get(metric)}
    if answer.get("value") is None:
        given["ranked"] = False
    own = {k: v for k, v in answer.items() if not (k in given and given[k] == v)}
    return {k: rounded_document(v, EVIDENCE_DIGITS if k in EVIDENCE else ANSWER_DIGITS) for k, v in own.items()}


@functools.cache
def metric_units() -> dict[str, str]:
    """Return the unit of every metric."""
    from attlog import metrics

    return {name: metric.unit for name, metric in metrics.definitions().items()}


def as_written(answer: Answer) -> Answer:
    """Round an answer to the digits of a document."""
    numbers = {"value": answer.value, "ci95": answer.ci95 and list(answer.ci95)}
    found: dict[str, Any] = rounded_document(numbers, ANSWER_DIGITS)
    units = answer.units
    if units is not None:
        units = replace(units, values=units.values.copy(), on=None)
        units.values[:] = rounded_document(units.values.tolist(), EVIDENCE_DIGITS)
    each = rounded_document(list(answer.each), EVIDENCE_DIGITS)
    ends = answer.ci95 and tuple(found["ci95"])
    return replace(answer, value=found["value"], ci95=ends, each=each, units=units)


def read(kind: type[T], content: bytes, name: str) -> T:
    """Parse the JSON text of a result of class ``kind``.

    UsageError, which begins with ``name``, for other texts.
    """
    from pydantic import ValidationError

    from attlog.core.settings import adapter, problem_lines

    found = _parsed(content, name)
    try:
        complete_answers(found)
        text = json.dumps(found, ensure_ascii=False)
        if NOT_UTF8.search(text):  # pydantic's JSON parser rejects names that are not UTF-8
            result: T = adapter(kind).validate_python(found, strict=False)
        else:
            result = adapter(kind).validate_json(text)
        return result
    except ValidationError as error:
        wrong = problem_lines(error, kind)
        more = f" (and {len(wrong) - MAX_ERRORS} more)" if len(wrong) > MAX_ERRORS else ""
        raise UsageError(f"{name}: not a result of attlog: {'; '.join(wrong[:MAX_ERRORS])}{more}") from None
    except ValueError as error:
        raise UsageError(f"{name}: not a result of attlog: {error}") from None
    except RecursionError:
        raise UsageError(f"{name}: not a result of attlog: nested too deeply") from None


def complete_answers(found: dict[str, Any]) -> None:
    """Set window and unit of every answer."""

    def tables(value: Any) -> list[tuple[str, Any]]:
        return list(value.items()) if isinstance(value, dict) else []

    rows = found.get("estimators")
    for row in rows if isinstance(rows, list) else ():
        for window, answers in tables(row.get("metrics") if isinstance(row, dict) else None):
            for metric, answer in tables(answers):
                if isinstance(answer, dict):
                    answers[metric] = {"unit": metric_units().get(metric, ""), "window": window} | answer


def _parsed(content: bytes, name: str) -> dict[str, Any]:
    """Parse the JSON object of a document. UsageError for another schema."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise UsageError(f"{name}: not a result of attlog: no UTF-8 text at byte {error.start}") from None
    try:
        found = json.loads(text, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        cut = " (the file ends there: it was cut off)" if error.pos >= len(text.rstrip()) else ""
        where = f"line {error.lineno}, column {error.colno}"
        raise UsageError(f"{name}: not valid JSON: {error.msg} in {where}{cut}") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{name}: not a result of attlog: {error}") from None
    schema = found.get("schema") if isinstance(found, dict) else None
    if not isinstance(schema, str) or not schema.startswith(SCHEMA_NAME):
        raise UsageError(f"{name}: not a result of attlog: it has no schema {SCHEMA_NAME}N")
    if schema != SCHEMA:
        number = schema.removeprefix(SCHEMA_NAME)
        newer = number.isdecimal() and len(number) < 9 and int(number) > SCHEMA_NUMBER
        what = "a newer attlog wrote it; update attlog" if newer else "analyse the log again with this version"
        raise UsageError(f"{name}: holds {schema[:40]} and this attlog reads {SCHEMA}: {what}")
    return dict(found)


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number of JSON")
