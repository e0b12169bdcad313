"""A result as its JSON document, and the way back.

Left out are fields with their default, the window and the unit of an answer (its place and its metric give them), and
the details that metrics keep for themselves. Answers have six significant digits, what stands behind them five.
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
# What differs between two runs of the same log; ``--deterministic`` leaves it out.
MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
# Bytes of a file name that are not UTF-8, as Python keeps them: UTF-8 cannot hold them, a JSON escape can.
NOT_UTF8 = re.compile("[\ud800-\udfff]")
# Intervals are wider than a percent.
ANSWER_DIGITS, EVIDENCE_DIGITS = 6, 5
EVIDENCE = ("each", "units")
# Errors that are printed of a document.
MAX_ERRORS = 3


def document(result: Any, deterministic: bool = False) -> dict[str, Any]:
    """Return the JSON document of a :class:`~attlog.result.Result`; ``deterministic``: without measured times."""
    found: dict[str, Any] = {"schema": SCHEMA} | to_plain(result, defaults=False) | {"schema": SCHEMA}
    if deterministic:
        found = without_keys(found, MEASURED_TIMES) | {"command": ""}
    for row in found.get("estimators", []):
        for window, answers in row.get("metrics", {}).items():
            for metric, answer in answers.items():
                answers[metric] = _written(answer, metric, window)
    return found


def _written(answer: dict[str, Any], metric: str, window: str) -> dict[str, Any]:
    """Return an answer without what its place gives."""
    given: dict[str, Any] = {"window": window, "unit": metric_units().get(metric)}
    if answer.get("value") is None:
        given["ranked"] = False
    own = {k: v for k, v in answer.items() if k != "detail" and not (k in given and given[k] == v)}
    return {k: rounded_document(v, EVIDENCE_DIGITS if k in EVIDENCE else ANSWER_DIGITS) for k, v in own.items()}


@functools.cache
def metric_units() -> dict[str, str]:
    """Return the unit of every metric."""
    from attlog import metrics

    return {name: metric.unit for name, metric in metrics.definitions().items()}


def as_written(answer: Answer) -> Answer:
    """Return an answer with the digits of a document: equal to one that was read back where both were equal."""
    numbers = {"value": answer.value, "ci95": answer.ci95 and list(answer.ci95)}
    found: dict[str, Any] = rounded_document(numbers, ANSWER_DIGITS)
    units = answer.units
    if units is not None:
        units = replace(units, values=units.values.copy(), on=None)
        units.values[:] = rounded_document(units.values.tolist(), EVIDENCE_DIGITS)
    each = rounded_document(list(answer.each), EVIDENCE_DIGITS)
    ends = answer.ci95 and tuple(found["ci95"])
    return replace(answer, value=found["value"], ci95=ends, each=each, units=units, detail={})


def read(kind: type[T], content: bytes, name: str) -> T:
    """Return the result (of the class ``kind``) in a JSON text. UsageError, which begins with ``name``, for others."""
    from pydantic import ValidationError

    from attlog.core.settings import adapter, problem_lines

    found = _parsed(content, name)
    try:
        complete_answers(found)
        text = json.dumps(found, ensure_ascii=False)
        if NOT_UTF8.search(text):  # a file name that is no text: pydantic's JSON does not take it, its Python does
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
    """Give every answer its window and unit; other types are left for the check of types."""

    def tables(value: Any) -> list[tuple[str, Any]]:
        return list(value.items()) if isinstance(value, dict) else []

    rows = found.get("estimators")
    for row in rows if isinstance(rows, list) else ():
        for window, answers in tables(row.get("metrics") if isinstance(row, dict) else None):
            for metric, answer in tables(answers):
                if isinstance(answer, dict):
                    answers[metric] = {"unit": metric_units().get(metric, ""), "window": window} | answer


def _parsed(content: bytes, name: str) -> dict[str, Any]:
    """Return the JSON object of a text of this schema. UsageError else."""
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
